"""Put flesh on one's own SMPL, SMPL-H or SMPL-X body. Nothing has to be trained.

python examples/11_your_own_body.py SMPLX_FEMALE.npz [MOTION.npz]

As a command: dsnet predict --body SMPLX_FEMALE.npz --motion MOTION.npz --out OUT
"""

import sys

import numpy as np

import dsnet

body_file = sys.argv[1] if len(sys.argv) > 1 else "embedded:male"
motion_file = sys.argv[2] if len(sys.argv) > 2 else "sample:jumping_jacks"
moving = dsnet.animate(motion_file, body=body_file)  # gains, loops, shapes as well
body = moving.body
print(f"{body.kind} of {body.vertex_count} vertices, {body.gender}: {moving.trained.why}")

# vertices_m is posed skin with flesh; offsets_m what a renderer adds at rest
vertices_m, offsets_m = moving.arrays()
largest_mm = 1e3 * np.linalg.norm(offsets_m, axis=-1).max(axis=0)  # (V,)
place = body.v_template[largest_mm.argmax()]
print(f"the skin swings by {largest_mm.max():.0f} mm at most, at {place.round(2)} of the template")
