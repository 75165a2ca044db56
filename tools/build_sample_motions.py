"""Write the short motions that come with the package.

    python tools/build_sample_motions.py

They are takes of the corpus's procedural motions by somebody who is in no corpus: the mean body of
the embedded female, 4 s at 60 frames a second. `walk_cycle` is one lap of such a walk, on a
treadmill: two steps of half a second, once they are steady, and the first frame again.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from bridge.body import load_body_model
from bridge.motion.readers.amass import CYCLE, SAMPLES, sample_path
from dsnet.synthetic.corpus_motions import write_amass_motion
from dsnet.synthetic.motions import Skeleton, perform
from dsnet.synthetic.motions.locomotion import walking
from dsnet.synthetic.motions.plan import Array, Planner
from dsnet.synthetic.motions.posing import pose_body

FPS, SECONDS, SEED = 60, 4, 2021
LAP = slice(148, 148 + FPS + 1)
"""Of a walk at tempo 1, whose two steps take a second; from where no foot lands or leaves."""
FORWARD = -1
"""The column of theta that holds the way that a body has gone ahead."""
KEPT = ("poses", "trans", "betas", "gender", "mocap_framerate", "source")


def main() -> None:
    """Write them all."""
    body = load_body_model("embedded:female")
    betas = np.zeros(10)
    skeleton = Skeleton(body, betas)
    for name in SAMPLES:
        theta = _walk_cycle(skeleton) if name == CYCLE else _take(name, skeleton)
        with tempfile.TemporaryDirectory() as folder:
            whole = Path(folder) / "motion.npz"
            write_amass_motion(
                whole,
                theta.astype(np.float64),
                betas=betas,
                gender="female",
                fps=FPS,
                root_joint_m=body.joints[0],
            )
            with np.load(whole) as arrays:
                kept = {key: arrays[key] for key in KEPT}
        small = {key: a.astype(np.float32) if a.dtype == float else a for key, a in kept.items()}
        np.savez_compressed(sample_path(name), **small)
        sys.stdout.write(f"{sample_path(name)}\n")


def _take(name: str, skeleton: Skeleton) -> Array:
    return perform(name, "sample", skeleton, frame_count=FPS * SECONDS, fps=FPS, seed=SEED, take=0)


def _walk_cycle(skeleton: Skeleton) -> Array:
    drawn = Planner.drawn("sample", CYCLE, np.arange(FPS * SECONDS) / FPS, skeleton.size, SEED)
    lap = pose_body(skeleton, walking(replace(drawn, tempo=1.0, amplitude=1.0)))[LAP]
    lap[:, FORWARD] -= np.linspace(0.0, lap[-1, FORWARD] - lap[0, FORWARD], len(lap))
    return lap


if __name__ == "__main__":
    main()
