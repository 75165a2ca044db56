"""Predict how the soft tissue of a body moves in a motion, without any training.

python examples/03_predict.py [MOTION.npz or .bvh]

The model that comes with the package was trained on synthetic tissue. The same as a command:
dsnet predict --motion sample:jumping_jacks --out OUT
"""

import sys

import numpy as np

import dsnet

motion = dsnet.load_motion(sys.argv[1] if len(sys.argv) > 1 else "sample:jumping_jacks")
moving = dsnet.animate(motion)  # animate(motion, "demo") uses the best predictor of that run

for posed in moving:  # a few frames at a time; moving.arrays() gives all at once
    size_mm = 1e3 * np.linalg.norm(posed.offsets_m, axis=-1)  # (T', V) in the rest pose
    height_m = posed.vertices_m[..., 1].max(axis=1)  # (T',) in the world, y up
    first, last = posed.frames.start / motion.fps, posed.frames.stop / motion.fps
    print(
        f"{first:5.2f} to {last:5.2f} s: offsets of {size_mm.mean():5.2f} mm on average, "
        f"{size_mm.max():5.1f} mm at most; top of the head at {height_m.max():.2f} m"
    )
