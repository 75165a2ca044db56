"""Flesh on some nodes of `dsnet_plus` for several sets of constants at once: what a fit rolls.

The steps are those of `bridge.tissue.oscillators`, in float64; motions and sets of constants lie
side by side, so that a derivative costs little more than one simulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.tissue.oscillators import FPS, STEPS, SWEEPS

_SETTLING_STEPS = 120
_STEP_S = 1 / (STEPS * FPS)


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

    coupled: NDArray[np.floating]
    """(K, K) dt^2 C / 4."""
    normals: NDArray[np.float64]
    """(K, 3)."""
    normal_ratio: NDArray[np.float64]
    """(K,)."""

    def roll(
        self, constants: Constants, loads: Sequence[NDArray], reading: Sequence[NDArray]
    ) -> list[NDArray[np.float64]]:
        """Offsets (T, N, 3, M), metres, of each motion's markers, from rest under the first load.

        Parameters
        ----------
        loads : (T, K, 3) of each of B motions, m/s^2: what moves the frame after.
        reading : (N, K) weights of the nodes in each motion's N markers.
        """
        longest = max(map(len, loads))
        padded = [np.concatenate([f, f[-1:].repeat(longest - len(f), 0)]) for f in loads]
        given = np.stack(padded, axis=3)[:, :, :, None]  # (T, K, 3, 1, B)
        springs = _Springs(self, constants)
        now = np.zeros((*given.shape[1:3], constants.omega.shape[1], len(loads)))
        before = now
        for _ in range(_SETTLING_STEPS):
            before, now = now, springs.step(now, before, given[0], springs.heavy)
        before = now
        pairs = zip(loads, reading, strict=True)
        found = [np.zeros((len(load), len(weights), *now.shape[1:3])) for load, weights in pairs]
        for frame in range(longest):
            for motion, weights in enumerate(reading):
                if frame < len(found[motion]):
                    found[motion][frame] = np.tensordot(weights, now[..., motion], 1)
            for _ in range(STEPS):
                before, now = now, springs.step(now, before, given[frame], springs.drag)
        return found


class _Springs:
    """A step's constants, (K, 1, M, 1)."""

    def __init__(self, patch: Patch, constants: Constants) -> None:
        def wide(values: NDArray) -> NDArray[np.float64]:
            return values[:, None, :, None]

        down = patch.normals[:, 1, None]
        hanging = constants.sag**2 * (1 + (patch.normal_ratio[:, None] - 1) * down**2)
        taut = constants.stiffening * hanging  # a |s|_P^2
        spring = _STEP_S**2 / 4 * constants.omega**2 / (1 + 3 * taut)
        self._spring, self._standing = wide(spring), wide(2 * spring * taut)
        self._stiffer = wide(2 * spring * constants.stiffening)
        self._hung = wide(2 * constants.sag) * np.array([0.0, -1.0, 0.0])[:, None, None]
        self.drag = _STEP_S * wide(constants.damping_ratio * constants.omega)
        self.heavy = _STEP_S * wide(constants.omega)
        self._normals = patch.normals[:, :, None, None]
        self._beyond = patch.normal_ratio[:, None, None, None] - 1
        bound = np.abs(patch.coupled).sum(axis=1)
        self._bound = bound[:, None, None, None]
        self._pulled = np.diag(bound) - np.asarray(patch.coupled, np.float64)

    def step(
        self, now: NDArray, before: NDArray, load: NDArray, drag: NDArray
    ) -> NDArray[np.float64]:
        """Offsets a step after `now`, which followed `before`."""
        strain = ((now + self._hung) * self._stretched(now)).sum(axis=1, keepdims=True)
        gained = self._stiffer * strain
        stiffer = self._standing + gained
        twice, after = 2 * now + before, 2 * now - before
        sheared = self._spring * twice + stiffer * before + gained * self._hung
        known = _STEP_S**2 * load + after + drag * before - self._stretched(sheared)
        known += self._pull(twice) - self._bound * twice
        held = self._spring + stiffer
        along = 1 + drag + self._bound + held
        beyond = self._beyond * held
        beyond = beyond / (along + beyond)
        for _ in range(SWEEPS):
            left = known + self._pull(after)
            outward = (left * self._normals).sum(axis=1, keepdims=True)
            after = (left - outward * beyond * self._normals) / along
        return after

    def _pull(self, offsets_m: NDArray) -> NDArray[np.float64]:
        return (self._pulled @ offsets_m.reshape(len(offsets_m), -1)).reshape(offsets_m.shape)

    def _stretched(self, offsets_m: NDArray) -> NDArray[np.float64]:
        outward = (offsets_m * self._normals).sum(axis=1, keepdims=True)
        return offsets_m + self._beyond * outward * self._normals
