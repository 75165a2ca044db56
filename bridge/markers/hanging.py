"""Flesh on some nodes of `dsnet_plus` for several sets of constants at once: what a fit rolls.

The law is that of `bridge.tissue.oscillators`, in time steps fine enough that nothing depends on
them; motions and sets of constants lie side by side, so that a derivative costs little more than
one simulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.tissue.oscillators import FPS

_STEPS = 4
"""In a frame."""
_SETTLING_S = 1.0


@dataclass(frozen=True, eq=False)
class Constants:
    """What is fitted: of K nodes, in M sets, (K, M) each."""

    omega: NDArray[np.float64]
    """W, 1/s."""
    damping_ratio: NDArray[np.float64]
    stiffening: NDArray[np.float64]
    """a, 1/m^2."""
    sag: NDArray[np.float64]
    """Metres."""


@dataclass(frozen=True, eq=False)
class Patch:
    """K nodes that move together, and what is not fitted of them."""

    coupling: NDArray[np.float64]
    """(K, K) C, 1/s^2."""
    normals: NDArray[np.float64]
    """(K, 3)."""
    normal_ratio: NDArray[np.float64]
    """(K,)."""

    def roll(
        self, constants: Constants, loads: Sequence[NDArray], reading: Sequence[NDArray]
    ) -> list[NDArray[np.float64]]:
        """Offsets (T, N, 3, M), metres, of each motion's markers.

        Parameters
        ----------
        loads : (T, K, 3) of each of B motions, m/s^2.
        reading : (N, K) weights of the nodes in each motion's N markers.
        """
        longest = max(map(len, loads))
        padded = [np.concatenate([f, f[-1:].repeat(longest - len(f), 0)]) for f in loads]
        given = np.stack(padded, axis=3)[:, :, :, None]  # (T, K, 3, 1, B)
        springs = _Springs(self, constants)
        shape = (*given.shape[1:3], constants.omega.shape[1], len(loads))
        offset_m, velocity = np.zeros(shape), np.zeros(shape)
        for _ in range(int(_SETTLING_S * FPS) * _STEPS):
            offset_m, velocity = springs.step(offset_m, velocity, given[0], springs.heavy)
        velocity = np.zeros(shape)
        found = [
            np.zeros((len(f), len(w), *shape[1:3])) for f, w in zip(loads, reading, strict=True)
        ]
        for frame in range(longest):
            for motion, weights in enumerate(reading):
                if frame < len(found[motion]):
                    found[motion][frame] = np.tensordot(weights, offset_m[..., motion], 1)
            if frame + 1 < longest:
                change = (given[frame + 1] - given[frame]) / _STEPS
                for step in range(_STEPS):
                    load = given[frame] + (step + 0.5) * change
                    offset_m, velocity = springs.step(offset_m, velocity, load, springs.drag)
        return found


class _Springs:
    """w^2 [(1 + a |v|_P^2) P v - (1 + a |s|_P^2) P s] about the sag s, and its steps."""

    def __init__(self, patch: Patch, constants: Constants) -> None:
        def wide(values: NDArray) -> NDArray[np.float64]:
            return values[:, None, :, None]

        down = patch.normals[:, 1, None]
        taut = 1 + (patch.normal_ratio[:, None] - 1) * down**2
        strain = constants.stiffening * constants.sag**2 * taut  # a |s|_P^2
        self._slack = wide(constants.omega**2 / (1 + 3 * strain))
        self._stiffer = wide(constants.stiffening)
        self._normals = patch.normals[:, :, None, None]
        self._beyond = patch.normal_ratio[:, None, None, None] - 1
        self._firmest = np.maximum(patch.normal_ratio, 1)[:, None, None, None]
        self._sag_m = wide(constants.sag) * np.array([0.0, -1.0, 0.0])[:, None, None]
        self._coupling = patch.coupling
        self._step_s = 1 / (FPS * _STEPS)
        self.drag = self._step_s * wide(constants.damping_ratio * constants.omega)
        self.heavy = self._step_s * wide(constants.omega)
        self._held = self._pull(self._sag_m)[0]

    def _pull(self, stretch_m: NDArray) -> tuple[NDArray, NDArray]:
        outward = (stretch_m * self._normals).sum(axis=1, keepdims=True)
        pulled = stretch_m + self._beyond * outward * self._normals
        strain = self._stiffer * (stretch_m * pulled).sum(axis=1, keepdims=True)
        return self._slack * (1 + strain) * pulled, strain

    def step(
        self, offset_m: NDArray, velocity: NDArray, load: NDArray, drag: NDArray
    ) -> tuple[NDArray, NDArray]:
        """The implicit midpoint, linearised; neighbours pull by where they were."""
        pull, strain = self._pull(offset_m + self._sag_m)
        stiffness = self._slack * self._firmest * (1 + 3 * strain)
        around = (self._coupling @ offset_m.reshape(len(offset_m), -1)).reshape(offset_m.shape)
        half = self._step_s / 2
        middle = (velocity + half * (load - (pull - self._held) - around)) / (
            1 + drag + half**2 * stiffness
        )
        return offset_m + self._step_s * middle, 2 * middle - velocity
