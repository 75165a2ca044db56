"""Predict how the flesh of a body moves in a motion. Nothing has to be trained before.

python examples/03_predict.py [MOTION.npz or .bvh]

The model that comes with the package was trained on synthetic tissue; the same as a command:
dsnet predict --motion sample:jumping_jacks --out OUT
"""

import sys

import numpy as np

from bridge.motion import load_motion_file
from dsnet.prediction.controls import Controls, controlled_body
from dsnet.prediction.load_model import load_model

motion = load_motion_file(sys.argv[1] if len(sys.argv) > 1 else "sample:jumping_jacks")
trained = load_model(run=None, gender=motion.gender)  # Run("demo") takes that run's best
moving = controlled_body(trained, motion, Controls())

for posed in moving:  # some frames at a time: memory does not grow with the motion
    size_mm = 1e3 * np.linalg.norm(posed.offsets_m, axis=-1)  # (T', V) in the rest pose
    height_m = posed.vertices_m[..., 1].max(axis=1)  # (T',) in the world, y up
    first, last = posed.frames.start / motion.fps, posed.frames.stop / motion.fps
    print(
        f"{first:5.2f} to {last:5.2f} s: skin is off by {size_mm.mean():5.2f} mm on average, "
        f"{size_mm.max():5.1f} mm at most; the head at {height_m.max():.2f} m"
    )
