"""A run's offsets as coefficients of principal components, with what these leave out accounted for.

Distances of offsets are then sums over a hundred numbers: dozens of networks are trained and scored
against the true offsets in minutes, without decoding a mesh.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bridge.exchange.dsnet import UnpaddedClip, join_inputs
from bridge.motion.splits import CELLS
from bridge.paper import LATENT_SIZE, N_VERTICES
from bridge.runs import Run
from dsnet.evaluation.pipelines import MotionArrays

VALIDATION = "validation"
MOTIONS = {"align": "infer", "align_robust": "infer_plus"}
"""Which stage holds the motions and shapes that a pipeline's predictors are given."""
_EVERY = 4
"""Of the training frames, those that the components are fitted to."""
_CHUNK = 256


@dataclass(frozen=True, eq=False)
class Reference:
    """Offsets that predictions are held against: coefficients, and squares that they leave out."""

    codes: NDArray[np.float64]
    """(T, 100), metres."""
    left_out: NDArray[np.float64]
    """(T,) squared distance from the components' span."""
    squares: NDArray[np.float64]
    """(T,) squared size of the offsets."""

    def errors(self, codes: NDArray) -> NDArray[np.float64]:
        """(T,) squared error of predicted coefficients, as of the offsets that they stand for."""
        return np.square(codes - self.codes).sum(axis=1) + self.left_out


@dataclass(frozen=True, eq=False)
class ScoredMotion:
    """A sequence to predict: motion, shape and the offsets that are right."""

    name: str
    cell: str
    theta: NDArray
    betas: NDArray
    reference: Reference


class StudyData:
    """What a run's alignment gives to learn from, and its held-out clip and test motions."""

    def __init__(self, run: Run, alignment: str) -> None:
        names = (alignment, MOTIONS[alignment], "truth", "evaluate")
        stages = {name: run.artifact(name) for name in names}
        self._aligned, self._motions, self._truth = (MotionArrays.of(stages[n]) for n in names[:3])
        self._cells: Mapping[str, str] = {
            one["name"]: one["cell"] for one in stages["evaluate"].manifest["per_sequence"]
        }
        sequences = self._aligned.sequences.values()
        self._train = [one.name for one in sequences if one.split == "train"]
        self._held_out = [one.name for one in sequences if one.split == VALIDATION]

    @cached_property
    def components(self) -> tuple[NDArray, NDArray]:
        """Mean (V * 3,) and orthonormal directions (100, V * 3) of the training frames."""
        frames = np.concatenate([self._flat(self._aligned, n)[::_EVERY] for n in self._train])
        mean = frames.mean(axis=0)
        frames -= mean
        values, vectors = np.linalg.eigh(frames @ frames.T)
        leading = vectors[:, ::-1][:, :LATENT_SIZE] / np.sqrt(values[::-1][:LATENT_SIZE])
        return mean, np.ascontiguousarray((frames.T @ leading).T)

    def reference(self, arrays: MotionArrays, name: str) -> Reference:
        """A sequence's offsets, aligned or true."""
        mean, directions = self.components
        flat = self._flat(arrays, name)
        squares = np.square(flat, dtype=np.float64).sum(axis=1)
        centred = flat - mean
        codes = (centred @ directions.T).astype(np.float64)
        left_out = np.square(centred, dtype=np.float64).sum(axis=1) - np.square(codes).sum(axis=1)
        return Reference(codes, left_out, squares)

    def clips(self, split: str) -> list[UnpaddedClip]:
        """What networks learn from, or are validated on."""
        names = self._train if split == "train" else self._held_out
        aligned = self._aligned
        return [
            UnpaddedClip(
                join_inputs(aligned.frames("theta", name, slice(None)), aligned.betas(name)),
                self.reference(aligned, name).codes.astype(np.float32),
            )
            for name in names
        ]

    def tested(self) -> list[ScoredMotion]:
        """The held-out clip against its aligned offsets, as the paper has it; test motions against
        the true ones."""
        found = []
        for name, cell in self._cells.items():
            if cell in (VALIDATION, *CELLS):
                arrays = self._aligned if cell == VALIDATION else self._truth
                theta = self._motions.frames("theta", name, slice(None))
                reference = self.reference(arrays, name)
                found.append(ScoredMotion(name, cell, theta, self._motions.betas(name), reference))
        return found

    @staticmethod
    def _flat(arrays: MotionArrays, name: str) -> NDArray[np.float32]:
        offsets_m = arrays.frames("offsets", name, slice(None))
        return np.array(offsets_m).reshape(len(offsets_m), -1)


def root_mean_square_mm(tested: Sequence[ScoredMotion], cell: str) -> float:
    """Of a test group's true offsets: what tells the data of one run from another's."""
    squares = np.concatenate([one.reference.squares for one in tested if one.cell == cell])
    return round(1e3 * float(np.sqrt(squares.mean() / N_VERTICES)), 4)


def r2(errors: NDArray, squares: NDArray) -> float:
    """1 for no error, 0 for no offset."""
    return float(1.0 - errors.sum() / squares.sum())
