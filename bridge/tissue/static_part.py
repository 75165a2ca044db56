"""What offsets have of the pose alone, fitted by ridge regression and kept only if it carries over.

Registrations hold more than dynamics: the person's own shape that the betas lack, and deformation
by pose that the blend shapes lack. To what the oscillators leave of the offsets, at the nodes,

    residual_t = constant of the person + sum_i (R - I)_i,t B_i

is fitted. As an absolute pose is what ruins predictions of unseen motions (docs/findings.md), every
kind of motion is left out once, and the fit with the least error on those left out is taken; no
static part at all is one of the candidates, and the simplest that comes near the best is chosen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.motion.splits import kind_of
from bridge.tissue.node_clips import NodeClip

RIDGES = (None, np.inf, 1e-1, 1e-2, 1e-3, 1e-4)
"""Candidates: no static part, a constant alone, and pose features with weaker and weaker ridge."""
_WORTH = 0.02
"""Share of the error that a less simple candidate must take away to be chosen."""
_CONSTANT_RIDGE = 1e-4
_MOST_FOLDS = 32
"""Of more kinds of motion several are left out together: the equations of each fold take
megabytes."""


class _Sums(NamedTuple):
    """Normal equations of some clips: X (n, P + 207), Y (n, 3 K)."""

    gram: NDArray[np.floating]
    right: NDArray[np.floating]
    energy: float
    frames: int

    def plus(self, other: _Sums, sign: int = 1) -> _Sums:
        """Those of both together; with sign -1, of those that are not among `other`'s."""
        return self._make(mine + sign * theirs for mine, theirs in zip(self, other, strict=True))

    def error(self, solution: NDArray) -> float:
        """Sum of squares that `solution` leaves of these clips."""
        explained = 2 * np.vdot(solution, self.right) - np.vdot(solution, self.gram @ solution)
        return self.energy - float(explained)


@dataclass(frozen=True, eq=False)
class NodeStatic:
    """A static part at the nodes: of each person, and by the pose."""

    constant_m: NDArray[np.float32]  # (P, K, 3)
    by_pose_m: NDArray[np.float32]  # (207, K, 3)

    @property
    def kind(self) -> str:
        """What the fit chose: `none`, a `constant` of each person, or of the `pose` besides."""
        if self.by_pose_m.any():
            return "pose"
        return "constant" if self.constant_m.any() else "none"

    def of(self, clip: NodeClip) -> NDArray[np.float32]:
        """(T, K, 3) for one clip."""
        return self.constant_m[clip.person] + np.tensordot(clip.features, self.by_pose_m, 1)

    @classmethod
    def nothing(cls, people: int, features: int, nodes: int) -> NodeStatic:
        return cls(*(np.zeros((count, nodes, 3), np.float32) for count in (people, features)))


def fit_static(clips: Sequence[NodeClip], moving_m: Sequence[NDArray], people: int) -> NodeStatic:
    """The static part of what the oscillators' `moving_m` (T, K, 3) leave of each clip."""
    numbers: dict[str, int] = {}
    folds: dict[int, _Sums] = {}
    for clip, moving in zip(clips, moving_m, strict=True):
        number = numbers.setdefault(kind_of(clip.sequence.motion), len(numbers))
        sums, fold = _sums(clip, clip.offsets_m - moving, people), number % _MOST_FOLDS
        folds[fold] = folds[fold].plus(sums) if fold in folds else sums
    total = reduce(_Sums.plus, folds.values())
    # With one kind of motion nothing says what carries over.
    candidates = RIDGES if len(folds) > 1 else RIDGES[:1]
    errors = np.array([_left_out(folds, total, ridge, people) for ridge in candidates])
    best = np.flatnonzero(errors <= errors.min() + _WORTH * total.energy)[0]
    solution = _solve(total, candidates[best], people)
    at_nodes = solution.reshape(len(solution), -1, 3).astype(np.float32)
    return NodeStatic(*np.split(at_nodes, [people]))


def _sums(clip: NodeClip, residual_m: NDArray, people: int) -> _Sums:
    person = np.zeros((len(clip), people))
    person[:, clip.person] = 1.0
    inputs = np.concatenate([person, clip.features], axis=1)
    outputs = residual_m.reshape(len(clip), -1).astype(np.float64)
    energy = float(np.square(outputs).sum())
    return _Sums(inputs.T @ inputs, inputs.T @ outputs, energy, len(clip))


def _left_out(folds: dict[int, _Sums], total: _Sums, ridge: float | None, people: int) -> float:
    """Sum of squares left of every fold by what the others say."""
    if ridge is None:
        return total.energy
    return sum(fold.error(_solve(total.plus(fold, -1), ridge, people)) for fold in folds.values())


def _solve(sums: _Sums, ridge: float | None, people: int) -> NDArray[np.floating]:
    """(P + 207, 3 K); zeros where there is no static part, or none of the pose."""
    solution = np.zeros_like(sums.right)
    if ridge is None:
        return solution
    used = slice(0, people if np.isinf(ridge) else None)
    penalty = np.full(len(sums.gram), 0.0 if np.isinf(ridge) else ridge * sums.frames)
    penalty[:people] = _CONSTANT_RIDGE * sums.frames
    curvature = sums.gram[used, used] + np.diag(penalty[used])
    solution[used] = np.linalg.solve(curvature, sums.right[used])
    return solution
