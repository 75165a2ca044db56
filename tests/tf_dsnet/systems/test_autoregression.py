"""A known law is found again from what it made."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.systems.autoregression import Autoregression, DrivenClip, OneStepFit

DIM, INPUTS = 4, 3
SHAPES = (-1.0, 0.2, 1.5)


def oscillators(radius: float, seed: int = 0) -> Autoregression:
    """Coupled damped oscillators whose frequencies and answers depend on the shape."""
    rng = np.random.default_rng(seed)
    basis = rng.normal(size=(DIM, DIM))
    angles = rng.uniform(0.1, 0.6, DIM)

    def law(shape: float) -> NDArray:
        first = basis @ np.diag(2 * radius * np.cos(angles + 0.03 * shape)) @ np.linalg.inv(basis)
        return np.concatenate([first.T, -(radius**2) * np.eye(DIM)])

    # Linear in the shape, as the law is: through its values at 0 and 1.
    past = np.stack([law(0.0), law(1.0) - law(0.0)])
    rest = rng.normal(size=(2, INPUTS + 1, DIM)) * np.array([1.0, 0.3])[:, None, None]
    return Autoregression(np.concatenate([past, rest], axis=1))


def clips(law: Autoregression, frames: int = 120, seed: int = 1) -> list[DrivenClip]:
    """What the law makes of random drivers."""
    rng = np.random.default_rng(seed)
    drivers = [rng.normal(size=(frames, INPUTS)) for _ in SHAPES]
    pairs = zip(drivers, SHAPES, strict=True)
    return [DrivenClip(x, law.roll(x, shape), shape) for x, shape in pairs]


def test_a_known_law_is_found_from_its_own_motion_and_rolls_on_elsewhere():
    truth = oscillators(0.95)
    found = OneStepFit(clips(truth)).with_ridge(1e-12)
    np.testing.assert_allclose(found.weights, truth.weights, atol=1e-6)
    for clip in clips(truth, seed=2):
        rolled = found.roll(clip.driver, clip.shape)
        np.testing.assert_allclose(rolled, clip.state, atol=1e-5 * np.abs(clip.state).max())
