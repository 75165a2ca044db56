"""Read a motion as the networks see it: 60 frames a second, y up, 69 numbers a frame.

python examples/02_read_a_motion.py [MOTION.npz or .bvh]
"""

import sys

import numpy as np

from bridge.motion import load_motion_file, unpack_theta

motion = load_motion_file(sys.argv[1] if len(sys.argv) > 1 else "sample:jumping_jacks")
pose, trans_m = unpack_theta(motion.theta)  # (T, 22, 3) axis-angle and (T, 3)

print(f"{motion.source}: {len(motion.theta)} frames, {motion.duration_s:.2f} s")
print(f"recorded at {motion.source_fps:g} frames a second, of a {motion.gender} body")
print(f"the root rises by {100 * np.ptp(trans_m[:, 1]):.0f} cm")
turns_rad = np.ptp(pose, axis=0).max(axis=-1)  # (22,)
print(f"joint {turns_rad.argmax()} turns most: by {np.degrees(turns_rad.max()):.0f} degrees")
