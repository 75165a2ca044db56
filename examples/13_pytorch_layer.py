"""Soft tissue inside a PyTorch program: offsets of two people, and how they follow their shapes.

python examples/13_pytorch_layer.py [SMPL_FEMALE.pkl]

Vertices are in the order of that file, as smplx poses them; without it, of the embedded body.
"""

import sys

import torch

import dsnet

torch.set_num_threads(1)  # for few people: on a busy machine threads wait for one another
layer = dsnet.soft_tissue(body=sys.argv[1] if len(sys.argv) > 1 else None)
motion = dsnet.load_motion("sample:jumping_jacks")
theta = torch.from_numpy(motion.theta[:90]).float().repeat(2, 1, 1)  # (2, T, 69)
betas = torch.zeros(2, 10)
betas[1, 1] = -1.0
betas.requires_grad_()

offsets_m, state = layer(theta, betas)  # (2, T, V, 3) in the rest pose; state: to go on later
lengths_mm = 1e3 * offsets_m.norm(dim=-1)
print(f"{tuple(offsets_m.shape)}: at most {lengths_mm.amax((1, 2)).tolist()} mm")

# posed = smplx.create(...)(betas, body_pose, global_orient, transl).vertices, and then
# moving = posed + layer.in_world(offsets_m, theta)
moved_m = layer.in_world(offsets_m, theta)
print(f"in the world, at most {1e3 * moved_m.detach().norm(dim=-1).max():.1f} mm")

lengths_mm.mean().backward()
assert betas.grad is not None
print(f"a unit of the second beta changes the mean by {betas.grad[:, 1].tolist()} mm")
