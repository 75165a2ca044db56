"""Characters whose poses come frame by frame, as in a game: they join, move, and leave."""

import numpy as np

import dsnet

bodies = dsnet.Stream(fps=60)  # of the package; Stream("demo") takes that run's best
motion = bodies.placed(dsnet.load_motion("sample:jumping_jacks"))  # or a file of yours

anna = bodies.join(motion.betas)
bella = None
print(f"answers are {1000 * bodies.latency_s:.0f} ms late")
for frame in range(120):
    if frame == 60:
        bella = bodies.join(np.array([2.0, *np.zeros(9)]))
    poses = {who: motion.theta[frame] for who in (anna, bella) if who is not None}
    moved = bodies.step(poses)
    if frame % 30 == 29:
        for who, body in moved.items():
            offset_mm = 1e3 * np.linalg.norm(body.offsets_m, axis=-1).max()
            print(f"frame {frame:3d}, character {who}: skin off by up to {offset_mm:.1f} mm")
bodies.leave(anna)
print(f"still there: {bodies.characters}")
