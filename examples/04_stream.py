"""Characters whose poses come frame by frame, as in a game: they join, move, and leave."""

import numpy as np

import dsnet

stream = dsnet.Stream(fps=60)  # Stream("demo") uses the best predictor of that run
motion = stream.placed(dsnet.load_motion("sample:jumping_jacks"))  # or a file of yours

anna = stream.join(motion.betas)
bella = None
print(f"results are {1000 * stream.latency_s:.0f} ms late")
for frame in range(120):
    if frame == 60:
        bella = stream.join(np.array([2.0, *np.zeros(9)]))
    poses = {number: motion.theta[frame] for number in (anna, bella) if number is not None}
    moved = stream.step(poses)
    if frame % 30 == 29:
        for number, body in moved.items():
            offset_mm = 1e3 * np.linalg.norm(body.offsets_m, axis=-1).max()
            print(f"frame {frame:3d}, character {number}: offsets of up to {offset_mm:.1f} mm")
stream.leave(anna)
print(f"remaining characters: {stream.characters}")
