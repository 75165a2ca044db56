"""Put flesh on one's own SMPL, SMPL-H or SMPL-X body. Nothing has to be trained.

python examples/11_your_own_body.py SMPLX_FEMALE.npz [MOTION.npz]

As a command: dsnet predict --body SMPLX_FEMALE.npz --motion MOTION.npz --out OUT
"""

import sys
from pathlib import Path

import numpy as np

from dsnet.prediction.controls import Controls, controlled_body

body_file = sys.argv[1] if len(sys.argv) > 1 else "embedded:male"
motion_file = sys.argv[2] if len(sys.argv) > 2 else "sample:jumping_jacks"
controls = Controls(body=Path(body_file))  # gains, loops, shapes as well
trained, motion = controls.load(None, None, Path(motion_file))
moving = controlled_body(trained, motion, controls)
body = trained.body
print(f"{body.kind} of {body.vertex_count} vertices, {body.gender}: {trained.why}")

largest_mm = np.zeros(body.vertex_count)
for posed in moving:  # vertices_m is posed skin with flesh; offsets_m what a renderer adds at rest
    size_mm = 1e3 * np.linalg.norm(posed.offsets_m, axis=-1)
    largest_mm = np.maximum(largest_mm, size_mm.max(axis=0))
place = body.v_template[largest_mm.argmax()]
print(f"the skin swings by {largest_mm.max():.0f} mm at most, at {place.round(2)} of the template")
