"""Read a motion as the networks see it: 60 frames a second, y up, 69 numbers a frame.

python examples/02_read_a_motion.py [MOTION.npz or .bvh]
"""

import sys

import numpy as np

import dsnet

motion = dsnet.load_motion(sys.argv[1] if len(sys.argv) > 1 else "sample:jumping_jacks")
print(f"{motion.source}: {len(motion.theta)} frames, {motion.duration_s:.2f} s")
print(f"recorded at {motion.source_fps:g} frames a second, gender {motion.gender}")
print(f"the root rises by {100 * np.ptp(motion.trans_m[:, 1]):.0f} cm")  # trans_m is (T, 3)
ranges_rad = np.ptp(motion.pose, axis=0).max(axis=-1)  # pose is (T, 22, 3) axis-angle
joint = ranges_rad.argmax()
print(f"joint {joint} turns most: by {np.degrees(ranges_rad[joint]):.0f} degrees")
