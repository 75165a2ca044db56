"""A linear law of the second order that is driven from outside and depends on one number.

    d_t = A1(s) d_{t-1} + A2(s) d_{t-2} + B(s) x_t + c(s),    every M(s) = M_0 + s M_1

Fitted frame by frame, which needs no search; used on its own past, which may grow without bounds
unless all of its modes decay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

DECAYING = 0.999
"""Largest spectral radius that is let stand: a free mode loses 6 % a second at 60 fps or more."""
_SHAPES_TRIED = 9


@dataclass(frozen=True, eq=False)
class DrivenClip:
    """One sequence."""

    driver: NDArray[np.floating]
    """(T, I) x."""
    state: NDArray[np.floating]
    """(T, D) d."""
    shape: float
    """s."""


@dataclass(frozen=True, eq=False)
class Autoregression:
    """The law's coefficients."""

    weights: NDArray[np.float64]
    """(2, D + D + I + 1, D): M_0 and M_1; rows of A1, A2, B and c, all transposed."""

    @property
    def size(self) -> int:
        """D."""
        return self.weights.shape[-1]

    def spectral_radius(self, shape: float) -> float:
        """Largest factor by which a free mode grows in a frame, at s = `shape`."""
        size = self.size
        companion = np.eye(2 * size, k=-size)
        companion[:size] = self._at(shape)[: 2 * size].T
        return float(np.abs(np.linalg.eigvals(companion)).max())

    def made_to_decay(self, low: float, high: float) -> Autoregression:
        """One whose modes decay at every s from `low` to `high`, itself if they do already.

        A1 times r and A2 times r^2 have all roots of z^2 = A1 z + A2 times r, at every s at once:
        frequencies stay as they are and every mode is damped alike.
        """
        largest = max(self.spectral_radius(s) for s in np.linspace(low, high, _SHAPES_TRIED))
        if largest <= DECAYING:
            return self
        factor, size = DECAYING / largest, self.size
        weights = self.weights.copy()
        weights[:, :size] *= factor
        weights[:, size : 2 * size] *= factor**2
        return Autoregression(weights)

    def roll(self, driver: NDArray, shape: float) -> NDArray[np.float64]:
        """States (T, D) that a driver (T, I) brings about, from zero and on its own past alone."""
        weights, size = self._at(shape), self.size
        past = weights[: 2 * size]
        states = np.zeros((len(driver) + 2, size))
        states[2:] = driver @ weights[2 * size : -1] + weights[-1]
        for frame in range(2, len(states)):
            states[frame] += np.concatenate([states[frame - 1], states[frame - 2]]) @ past
        return states[2:]

    def _at(self, shape: float) -> NDArray[np.float64]:
        return self.weights[0] + shape * self.weights[1]


class OneStepFit:
    """Least squares of every frame with two frames before it, with a ridge on every coefficient.

    Parameters
    ----------
    clips : what to fit; a clip of fewer than 3 frames adds nothing.
    """

    def __init__(self, clips: Sequence[DrivenClip]) -> None:
        self._rows, self._products, self._targets = 0, 0.0, 0.0
        for clip in clips:
            told, target = _regressors(clip), clip.state[2:].astype(np.float64)
            by_shape = np.array([1.0, clip.shape])
            self._products += np.kron(np.outer(by_shape, by_shape), told.T @ told)
            self._targets += np.kron(by_shape[:, None], told.T @ target)
            self._rows += len(target)

    def with_ridge(self, ridge: float) -> Autoregression:
        """The fit with a penalty of `ridge` for each frame."""
        products, targets = np.asarray(self._products), np.asarray(self._targets)
        penalty = ridge * max(self._rows, 1) * np.eye(len(products))
        found = np.linalg.solve(products + penalty, targets)
        return Autoregression(found.reshape(2, -1, found.shape[1]).astype(np.float64))


def _regressors(clip: DrivenClip) -> NDArray[np.float64]:
    """(T - 2, D + D + I + 1): the two states before a frame, its driver, and 1."""
    state, driver = clip.state.astype(np.float64), clip.driver.astype(np.float64)
    return np.concatenate([state[1:-1], state[:-2], driver[2:], np.ones((len(state[2:]), 1))], 1)
