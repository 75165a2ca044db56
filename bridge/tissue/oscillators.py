"""Coupled damped oscillators on the skin, stepped implicitly: the dynamics of `dsnet_plus`.

Each node's offset u from its skinned place obeys, in the rest pose's frame,

    u'' + 2 z w u' + w^2 (1 + a |u|_P^2) P u + C u = f,      f = h inertia + j gravity

with P = I + (p - 1) n n^T: skin on firm ground is p times as stiff along its normal n, where flesh
is pressed and pulled, as along itself, where it shears; |u|_P^2 = u^T P u. Neighbours are coupled
by C = c^2 L + D L^2, L the nodes' Laplacian: as a skin under tension and as a plate that resists
bending. One step of dt is Newmark's average acceleration written in three offsets, but for the
load, which is taken at t so that the next offset needs no later pose:

    (u+ - 2 u + u-) / dt^2 + 2 z w (u+ - u-) / (2 dt) + (w^2 P + C) (u+ + 2 u + u-) / 4
        + w^2 a |u|_P^2 P (u+ + u-) / 2 = f_t

Times u+ - u-, the last term on the left is w^2 a / 2 (|u|_P^2 |u+|_P^2 - |u-|_P^2 |u|_P^2): like
the others it is what one step's energy has more than the last one's. So without load the energy

    |u+ - u|^2 / dt^2 / 2 + w^2 |u+ + u|_P^2 / 8 + w^2 a |u+|_P^2 |u|_P^2 / 4 + the coupling's

never grows, however stiff the springs, and a load adds to its root 2^(-1/2) dt |f| a step at most.
That is so where C is symmetric up to the nodes' masses, as with even c and D; that uneven ones ring
out too is tested, not proved.

A step swings a node by 2 atan(w dt / 2) instead of w dt: too slowly, and the more so the stiffer an
impact makes it. A frame is two steps: on violent motion one is not enough (docs/prediction.md).

The matrix on u+ is B + dt^2 C / 4, B each node's own block. With N the sums of dt^2 |C| / 4 over
rows, B + N bounds it from above, and sweeps of Jacobi's kind

    u+ <- (B + N)^-1 (known + (N - dt^2 C / 4) u+)

solve it. Of a mode that has the share s of B + N, (1 - s)^2 is left after two: nothing of a lone
node, and never less than nothing, so no change of velocity is overdone, and what sweeps leave
feeds no vibration.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import bicgstab, splu

from bridge.tissue.load import Load

FPS = 60.0
STEPS = 2
"""In a frame."""
SWEEPS = 2
"""In a step; they start from u+ = 2 u - u-."""
_SETTLING = 200
_SETTLED = 1e-7
"""Change of the strain, relative to the largest, at which tissue is at rest."""
_SOLVED = 1e-9
"""Residual of a linear system, relative to its right side, at which iteration ends."""


@dataclass(frozen=True, eq=False)
class NodeMechanics:
    """Coefficients of K nodes of one person, (K, 1) each but for the normals."""

    omega: NDArray[np.float32]
    """w: 2 pi times the frequency of a small free vibration along the skin, 1/s."""
    damping_ratio: NDArray[np.float32]
    """z."""
    stiffening: NDArray[np.float32]
    """a, 1/m^2."""
    normal_ratio: NDArray[np.float32]
    """p: stiffness along the normal over that along the skin."""
    wave_speed: NDArray[np.float32]
    """c: of waves in a skin under tension, m/s."""
    bending: NDArray[np.float32]
    """D: resistance to bending per mass, m^4/s^2."""
    inertia_gain: NDArray[np.float32]
    """h: 1 where tissue is as heavy as what carries it accelerates."""
    gravity_gain: NDArray[np.float32]
    """j."""
    normals: NDArray[np.float32]
    """(K, 3) n, outward, in the rest pose."""
    taps: NDArray[np.float32]
    """(N,) shares of f in the load of a step, from the newest frame to the oldest."""
    look_ahead: int
    """Frames after t that the newest of them lies; 0 needs no later pose."""

    def load(self, load: Load) -> NDArray[np.floating]:
        """f (T, K, 3), m/s^2, smoothed in time by the taps."""
        return smoothed(self.felt(load), self.taps, self.look_ahead)

    def felt(self, load: Load) -> NDArray[np.floating]:
        """f (T, K, 3), m/s^2, of each frame alone."""
        return self.inertia_gain * load.inertia + self.gravity_gain * load.gravity


def smoothed(felt: NDArray, taps: NDArray, look_ahead: int) -> NDArray[np.floating]:
    """Sum over i of taps[i] felt[t + look_ahead - i]; the first and last frame go on for ever."""
    count = len(felt)
    frames = np.arange(count)[:, None] + look_ahead - np.arange(len(taps))
    parts = (
        tap * felt[np.clip(row, 0, count - 1)] for tap, row in zip(taps, frames.T, strict=True)
    )
    return np.asarray(sum(parts), np.float32)


class OscillatorSheet:
    """The nodes of one person.

    Parameters
    ----------
    mechanics : their coefficients.
    laplacian : (K, K) of `TissueNodes`.
    fps : frames per second of the loads.
    """

    def __init__(
        self, mechanics: NodeMechanics, laplacian: sp.csr_matrix, fps: float = FPS
    ) -> None:
        step_s = 1 / (STEPS * fps)
        square = np.float32(step_s**2)
        self._step_s, self._square = np.float32(step_s), square
        self._take(mechanics)
        tension, bending = mechanics.wave_speed[:, 0] ** 2, mechanics.bending[:, 0]
        pulls = sp.diags(tension) @ laplacian + sp.diags(bending) @ laplacian @ laplacian
        self._coupling = sp.csr_matrix(square / 4 * pulls)
        bound = np.asarray(abs(self._coupling).sum(1))
        self._bound = bound.astype(np.float32)
        # Dense: with few hundred nodes faster than a sparse product, as L^2 fills rows.
        self._rest = (np.diag(bound[:, 0]) - self._coupling.toarray()).astype(np.float32)

    def _take(self, mechanics: NodeMechanics) -> None:
        self._spring = self._square / 4 * mechanics.omega**2
        self._stiffening = mechanics.stiffening
        self._normals, self._beyond = mechanics.normals, mechanics.normal_ratio - 1
        self._drag = mechanics.omega * mechanics.damping_ratio * self._step_s

    def of_people(self, people: Sequence[NodeMechanics]) -> OscillatorSheet:
        """The nodes of B persons side by side, for `frame` and `step` alone: offsets and loads are
        (K, B, 3), and one matrix product serves all.

        Neighbours must be coupled as in this sheet, as in everybody of one trained model.
        """
        fields = {
            name: np.stack([getattr(person, name) for person in people], axis=1)
            for name in ("omega", "damping_ratio", "stiffening", "normal_ratio", "normals")
        }
        several = copy(self)
        several._take(replace(people[0], **fields))
        several._bound = self._bound[:, None]
        return several

    @property
    def coupling(self) -> sp.csr_matrix:
        """(K, K) dt^2 C / 4."""
        return self._coupling

    @property
    def bound(self) -> NDArray[np.float32]:
        """(K, 1) N."""
        return self._bound

    @property
    def pulled(self) -> NDArray[np.float32]:
        """(K, K) N - dt^2 C / 4."""
        return self._rest

    def settled(self, load: NDArray) -> NDArray[np.floating]:
        """(K, 3) at rest under a constant load (K, 3): (k P + C) u = f.

        Solved for the strain |u|_P^2, by Newton's method as if each node's neighbours stood still.
        """
        pull = self._square / 4 * load.astype(np.float64)
        offset_m, strain = np.zeros_like(pull), np.zeros((len(load), 1))
        coupling = sp.kron(self._coupling, sp.eye(3))
        own_pull = self._coupling.diagonal()[:, None]
        for _ in range(_SETTLING):
            stiffer = self._spring * self._stiffening * strain
            system = sp.csr_matrix(coupling + self._blocks(self._spring + stiffer))
            offset_m = _solved(system, pull, offset_m)
            found = _dot(offset_m, self._stretched(offset_m))
            held = self._spring + own_pull + stiffer
            falls = 2 * found * self._spring * self._stiffening / held
            before, strain = strain, strain + (found - strain) / (1 + falls)
            if np.abs(strain - before).max() <= _SETTLED * strain.max():
                break
        return offset_m.astype(np.float32)

    def frame(
        self, now: NDArray, before: NDArray, load: NDArray
    ) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """Offsets (K, 3) a frame after `now`, and a step before that, under load f_t (K, 3).

        `before` is a step, not a frame, before `now`.
        """
        for _ in range(STEPS):
            before, now = now, self.step(now, before, load)
        return now, before

    def step(self, now: NDArray, before: NDArray, load: NDArray) -> NDArray[np.floating]:
        """Offsets (K, 3) a step after `now`, which followed `before`, under load f_t (K, 3)."""
        stiffer = 2 * self._spring * self._stiffening * _dot(now, self._stretched(now))
        twice, after = 2 * now + before, 2 * now - before
        known = self._square * load + after + self._drag * before
        known -= self._stretched(self._spring * twice + stiffer * before)
        known += self._pulled(twice) - self._bound * twice
        along = 1 + self._drag + self._bound + self._spring + stiffer
        # Each node's block is along I + beyond n n^T; Sherman and Morrison invert it.
        beyond = self._beyond * (self._spring + stiffer)
        lost = beyond / (along + beyond) * self._normals
        for _ in range(SWEEPS):
            left = known + self._pulled(after)
            after = (left - _dot(left, self._normals) * lost) / along
        return after

    def _pulled(self, offsets_m: NDArray) -> NDArray:
        """(N - dt^2 C / 4) u."""
        return (self._rest @ offsets_m.reshape(len(offsets_m), -1)).reshape(offsets_m.shape)

    def _stretched(self, offsets_m: NDArray) -> NDArray:
        """P u."""
        return offsets_m + self._beyond * _dot(offsets_m, self._normals) * self._normals

    def _blocks(self, springs: NDArray) -> sp.bsr_matrix:
        """(3 K, 3 K) of springs (K, 1) times P."""
        across = self._normals[:, :, None] * self._normals[:, None, :]
        blocks = springs[:, :, None] * (np.eye(3) + self._beyond[:, :, None] * across)
        return sp.bsr_matrix((blocks, np.arange(len(blocks)), np.arange(len(blocks) + 1)))

    def roll(self, loads: NDArray, rest: NDArray | None = None) -> NDArray[np.floating]:
        """Offsets (T, K, 3) under loads (T, K, 3), from rest under `rest` (K, 3) or the first."""
        offsets_m = np.empty_like(loads)
        before = now = offsets_m[0] = self.settled(loads[0] if rest is None else rest)
        for frame in range(1, len(loads)):
            now, before = self.frame(now, before, loads[frame - 1])
            offsets_m[frame] = now
        return offsets_m


def roll_clip(_: None, clip: tuple[NodeMechanics, sp.csr_matrix, Load]) -> NDArray[np.floating]:
    """Offsets (T, K, 3) of a person's nodes under the load of a clip: work for a worker pool."""
    mechanics, laplacian, load = clip
    return OscillatorSheet(mechanics, laplacian).roll(mechanics.load(load))


def _solved(system: sp.csr_matrix, pull: NDArray, guess: NDArray) -> NDArray:
    """(K, 3) with system times it = pull. Iterating from the last guess is many times faster."""
    diagonal = sp.diags(1 / system.diagonal())
    found, failed = bicgstab(system, pull.ravel(), guess.ravel(), rtol=_SOLVED, M=diagonal)
    if failed:
        found = splu(system.tocsc()).solve(pull.ravel())
    return found.reshape(-1, 3)


def _dot(first: NDArray, second: NDArray) -> NDArray:
    """(..., 1) of (..., 3) twice."""
    return np.einsum("...x,...x->...", first, second)[..., None]
