"""`python -m torch_align_ae.verify_engine`: what PyTorch answers to `dsnet verify`.

Operations and names are those of `bridge.verify.protocol`; the product's own networks, optimizers,
SMPL and files compute. A case may ask for a fault, so that one can see that it is found.
"""
