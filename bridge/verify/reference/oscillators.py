"""The sheet of oscillators in float64, as the equations of `bridge.tissue.oscillators` say it.

Plain and slow: every node's block is a matrix that is solved with, rest is Newton's method on all
offsets together.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from bridge.tissue.oscillators import FPS, STEPS, SWEEPS

_NEWTON, _SOLVED = 100, 1e-13


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Of K nodes of one person, (K, 1) each but for the normals."""

    omega: np.ndarray
    """w: 2 pi times the frequency of a small free vibration along the skin, 1/s."""
    damping_ratio: np.ndarray
    """z."""
    stiffening: np.ndarray
    """a, 1/m^2."""
    normal_ratio: np.ndarray
    """p: stiffness along the normal over that along the skin."""
    wave_speed: np.ndarray
    """c: of waves in a skin under tension, m/s."""
    bending: np.ndarray
    """D: resistance to bending per mass, m^4/s^2."""
    inertia_gain: np.ndarray
    """h: 1 where tissue is as heavy as what carries it accelerates."""
    gravity_gain: np.ndarray
    """j."""
    normals: np.ndarray
    """(K, 3) n, outward, in the rest pose."""

    def in_float64(self) -> Coefficients:
        """The same numbers; complex ones stay so, for `oscillator_training`."""
        arrays = [np.asarray(getattr(self, field.name)) for field in fields(self)]
        return Coefficients(*(a.astype(np.result_type(a, np.float64)) for a in arrays))


class Sheet:
    """The nodes of one person.

    Parameters
    ----------
    laplacian : (K, K) of the nodes.
    """

    def __init__(self, coefficients: Coefficients, laplacian: np.ndarray) -> None:
        self._c = c = coefficients.in_float64()
        across = c.normals[:, :, None] * c.normals[:, None, :]
        self._P = np.eye(3) + (c.normal_ratio - 1)[..., None] * across  # (K, 3, 3)
        tension = c.wave_speed**2 * laplacian
        self._C = tension + c.bending * (laplacian @ laplacian)
        self._dt = 1 / (STEPS * FPS)
        absolute = np.where(np.real(self._C) < 0, -self._C, self._C)
        self._N = self._dt**2 / 4 * absolute.sum(1, keepdims=True)

    def frame(
        self, now: np.ndarray, before: np.ndarray, load: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Offsets (K, 3) a frame after `now`, and a step before that, under a load (K, 3)."""
        for _ in range(STEPS):
            before, now = now, self.step(now, before, load)
        return now, before

    def step(self, now: np.ndarray, before: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Offsets (K, 3) a step after `now`, which followed `before`, metres."""
        c, square = self._c, self._dt**2
        drag = c.damping_ratio * c.omega * self._dt
        strain = (now * self._stretched(now)).sum(1, keepdims=True)
        stiffer = square / 2 * c.omega**2 * c.stiffening * strain
        twice = 2 * now + before
        known = square * load + 2 * now - before + drag * before
        pulled = square / 4 * (c.omega**2 * self._stretched(twice) + self._C @ twice)
        known = known - pulled - stiffer * self._stretched(before)
        blocks = (1 + drag + self._N)[..., None] * np.eye(3)
        blocks = blocks + (square / 4 * c.omega**2 + stiffer)[..., None] * self._P
        after = 2 * now - before
        for _ in range(SWEEPS):
            left = known + self._N * after - square / 4 * self._C @ after
            after = np.linalg.solve(blocks, left[..., None])[..., 0]
        return after

    def settled(self, load: np.ndarray) -> np.ndarray:
        """(K, 3) at rest under a constant load (K, 3)."""
        c, count = self._c, len(load)
        coupled = np.kron(self._C, np.eye(3))
        offsets_m, load = np.zeros((count, 3)), np.asarray(load, np.float64)
        for _ in range(_NEWTON):
            stretched = self._stretched(offsets_m)
            strain = (offsets_m * stretched).sum(1, keepdims=True)
            held = c.omega**2 * (1 + c.stiffening * strain)
            missing = load - held * stretched - self._C @ offsets_m
            rising = 2 * c.omega**2 * c.stiffening * stretched
            blocks = held[..., None] * self._P + rising[:, :, None] * stretched[:, None, :]
            slope = coupled.copy()
            for node, block in enumerate(blocks):
                mine = slice(3 * node, 3 * node + 3)
                slope[mine, mine] += block
            moved = np.linalg.solve(slope, missing.ravel()).reshape(count, 3)
            offsets_m = offsets_m + moved
            if np.abs(moved).max() <= _SOLVED * np.abs(offsets_m).max():
                return offsets_m
        raise ArithmeticError("tissue that does not come to rest")

    def _stretched(self, offsets_m: np.ndarray) -> np.ndarray:
        """P u."""
        return np.einsum("kxy,ky->kx", self._P, offsets_m)
