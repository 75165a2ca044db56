"""Write the short motions that come with the package.

    python tools/build_sample_motions.py

They are takes of the corpus's procedural motions by somebody who is in no corpus: the mean body of
the embedded female, 4 s at 60 frames a second.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from bridge.body import load_body_model
from bridge.motion.sample_files import SAMPLES, sample_path
from torch_align_ae.corpus.amass_files import write_amass_motion
from torch_align_ae.corpus.motions import Skeleton, perform

FPS, SECONDS, SEED = 60, 4, 2021
KEPT = ("poses", "trans", "betas", "gender", "mocap_framerate", "source")


def main() -> None:
    """Write them all."""
    body = load_body_model("embedded:female")
    betas = np.zeros(10)
    skeleton = Skeleton.of(body, betas)
    for name in SAMPLES:
        theta = perform(
            name, "sample", skeleton, frame_count=FPS * SECONDS, fps=FPS, seed=SEED, take=0
        )
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


if __name__ == "__main__":
    main()
