"""`python -m tf_dsnet.verify_engine`: what Keras and TensorFlow answer to `dsnet verify`.

Operations and names are those of `bridge.verify.protocol`; the product's own networks, trainer,
KerasSMPL and files compute.
"""
