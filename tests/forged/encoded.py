"""What stage `encode` leaves, without the stages before it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.motion import MotionSequence
from tests.forged.artifacts import put

SUBJECTS = ("50004", "50020")
MOTIONS = ("hips", "punching", "one_leg_jump")
LENGTHS = (25, 40, 30, 35, 20, 45)


def write_encoded(path: Path) -> None:
    """Six short sequences of two subjects, whose latents a motion's past decides."""
    rng = np.random.default_rng(0)
    names = [(subject, motion) for subject in SUBJECTS for motion in MOTIONS]
    sequences, start = [], 0
    for (subject, motion), length in zip(names, LENGTHS, strict=True):
        split = "validation" if (subject, motion) == ("50004", "one_leg_jump") else "train"
        sequences.append(
            MotionSequence(f"{subject}_{motion}", subject, motion, start, length, 60.0, split)
        )
        start += length
    theta = np.concatenate([_smooth_walk(rng, length) for length in LENGTHS])
    push = np.gradient(np.gradient(theta, axis=0), axis=0)
    latents = 5.0 + 20.0 * push @ rng.normal(size=(69, 100))
    arrays = {
        "theta": theta.astype(np.float32),
        "betas": rng.normal(size=(len(SUBJECTS), 10)).astype(np.float32),
        "latents": latents.astype(np.float32),
        "latents_pca": (1e-3 * latents[:, ::-1]).astype(np.float32),
        "latents_dmpl": (1e-3 * latents[:, 8:0:-1]).astype(np.float32),
    }
    put(path, arrays, sequences)


def _smooth_walk(rng: np.random.Generator, length: int) -> NDArray:
    phases = rng.uniform(0, 2 * np.pi, (1, 69))
    rates = rng.uniform(0.1, 0.3, (1, 69))
    return 0.3 * np.sin(rates * np.arange(length)[:, None] + phases)
