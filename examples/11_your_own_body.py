"""Move your own SMPL, SMPL-H or SMPL-X body with soft tissue, without any training.

python examples/11_your_own_body.py SMPLX_FEMALE.npz [MOTION.npz]

As a command: dsnet predict --body SMPLX_FEMALE.npz --motion MOTION.npz --out OUT
"""

import sys

import numpy as np

import dsnet

body_file = sys.argv[1] if len(sys.argv) > 1 else "embedded:male"
motion_file = sys.argv[2] if len(sys.argv) > 2 else "sample:jumping_jacks"
moving = dsnet.animate(motion_file, body=body_file)  # controls are keywords, as gain=1.5
body = moving.body
print(f"{body.kind} of {body.vertex_count} vertices, {body.gender}: {moving.trained.why}")

# vertices_m is the posed skin with soft tissue; offsets_m are added in the rest pose
vertices_m, offsets_m = moving.arrays()
largest_mm = 1e3 * np.linalg.norm(offsets_m, axis=-1).max(axis=0)  # (V,)
vertex_m = body.v_template[largest_mm.argmax()].round(2)
print(f"offsets of up to {largest_mm.max():.0f} mm, at {vertex_m} of the template")
