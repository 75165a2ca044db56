"""Latents that a known law of the second order makes of motions, for predictors to learn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.systems.dyna_like import body_mass_index
from benchmarks.systems.kinematics import KINEMATICS_SIZE, kinematics
from bridge.body import BodyModelData
from bridge.exchange.dsnet import UnpaddedClip, join_inputs
from tf_dsnet.predictors import TrainingData

_MODES = 5
_SIZE_M = 0.02


@dataclass(frozen=True, eq=False)
class TrueLaw:
    """Five damped modes, each a direction of latents, that a motion's rates set going."""

    angles: NDArray
    """(5,) of each mode in a frame, rad."""
    radius: float
    """Factor by which each fades in a frame."""
    into: NDArray
    """(138, 5) what rates do to modes."""
    directions: NDArray
    """(5, 100) orthonormal."""

    def latents(self, theta: NDArray, stoutness: float = 0.0) -> NDArray[np.float64]:
        """Latents (T, 100) of a motion theta (T, 69), from zero; stout people answer more."""
        push = kinematics(theta) @ self.into * (1 + 0.5 * stoutness)
        states = np.zeros((len(theta) + 2, _MODES))
        for frame in range(2, len(states)):
            states[frame] = (
                2 * self.radius * np.cos(self.angles) * states[frame - 1]
                - self.radius**2 * states[frame - 2]
                + push[frame - 2]
            )
        return states[2:] @ self.directions


def true_law(seed: int = 0) -> TrueLaw:
    """One with frequencies of 3 to 6 Hz."""
    rng = np.random.default_rng(seed)
    directions = np.linalg.qr(rng.normal(size=(100, _MODES)))[0].T
    into = rng.normal(size=(KINEMATICS_SIZE, _MODES)) / KINEMATICS_SIZE
    # Angular accelerations are tens of times as large as angular velocities.
    rates = kinematics(motion(300, 99)).std(axis=0)
    return TrueLaw(rng.uniform(0.3, 0.6, _MODES), 0.93, _SIZE_M * into / rates[:, None], directions)


def motion(frames: int, seed: int) -> NDArray[np.float64]:
    """A body (T, 69) that starts from rest and swings all its joints, turns and travels."""
    rng = np.random.default_rng([7, seed])
    phases, speeds = rng.uniform(0, 2 * np.pi, (2, 69)), rng.uniform(0.05, 0.35, (2, 69))
    frame = np.arange(frames)[:, None]
    swing = np.sin(speeds[0] * frame + phases[0]) + np.sin(speeds[1] * frame + phases[1])
    return 0.2 * (1 - np.exp(-frame / 5.0)) * swing


def people(count: int) -> list[NDArray[np.float64]]:
    """Betas (10,) each."""
    return list(np.random.default_rng(11).normal(size=(count, 10)))


def forged_data(
    body: BodyModelData, *, clips: int = 12, frames: int = 80, seed: int = 0
) -> TrainingData:
    """Clips of three people and one clip more for validation."""
    law, shapes = true_law(seed), people(3)
    bmi = np.array([body_mass_index(body, betas) for betas in shapes])
    stoutness = (bmi - bmi.mean()) / bmi.std()

    def clip(number: int) -> UnpaddedClip:
        person = number % len(shapes)
        theta = motion(frames - number % 5, number)
        return UnpaddedClip(
            join_inputs(theta, shapes[person]), law.latents(theta, stoutness[person])
        )

    return TrainingData([clip(n) for n in range(clips)], [clip(clips)], lambda: body)
