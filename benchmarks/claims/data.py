"""What a run gives the studies to learn from, and offsets to hold predictions against.

Of principal components, with what these leave out accounted for, distances of offsets are sums over
a hundred numbers: dozens of networks are scored in minutes, without decoding a mesh. The latents of
the paper's autoencoder are decoded.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.claims.references import (
    Decode,
    InComponents,
    InOffsets,
    Reference,
    ScoredMotion,
    root_mean_square_mm,
)
from bridge.exchange.dsnet import UnpaddedClip, join_inputs, load_unpadded_clips
from bridge.motion.sequences import Split
from bridge.motion.splits import CELLS
from bridge.paper import LATENT_SIZE
from bridge.runs import Artifact, Run
from dsnet.evaluation.pipelines import MotionArrays

VALIDATION = "validation"
KNOWN = "known_person_known_motion"
_EVERY = 4
"""Of the training frames, those that the components are fitted to."""


class StudyData(ABC):
    """What a run's alignment gives to learn from, and its held-out clip and test motions."""

    def __init__(self, run: Run, alignment: str, motions: str) -> None:
        names = (alignment, motions, "truth", "evaluate")
        stages = run.artifacts(*names)
        self._aligned, self._motions, self._truth = (MotionArrays.of(stages[n]) for n in names[:3])
        self._cells: Mapping[str, str] = {
            one["name"]: one["cell"] for one in stages["evaluate"].manifest["per_sequence"]
        }
        sequences = self._aligned.sequences.values()
        self._train = [one.name for one in sequences if one.split == "train"]
        self._held_out = [one.name for one in sequences if one.split == VALIDATION]

    @abstractmethod
    def clips(self, split: Split) -> list[UnpaddedClip]:
        """What networks learn from, or are validated on."""

    @abstractmethod
    def reference(self, arrays: MotionArrays, name: str) -> Reference:
        """A sequence's offsets, aligned or true."""

    @abstractmethod
    def identity(self) -> dict[str, Any]:
        """What tells this run's data from another's."""

    @cached_property
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


class ComponentsData(StudyData):
    """The robust aligner's motions, and principal components of its offsets."""

    def __init__(self, run: Run) -> None:
        super().__init__(run, "align_robust", "infer_plus")

    def identity(self) -> dict[str, Any]:
        """The size of one test group's true offsets."""
        return {"true_mm": root_mean_square_mm(self.tested, KNOWN)}

    @cached_property
    def components(self) -> tuple[NDArray, NDArray]:
        """Mean (V * 3,) and orthonormal directions (100, V * 3) of the training frames."""
        frames = np.concatenate([self._flat(self._aligned, n)[::_EVERY] for n in self._train])
        mean = frames.mean(axis=0)
        frames -= mean
        values, vectors = np.linalg.eigh(frames @ frames.T)
        leading = vectors[:, ::-1][:, :LATENT_SIZE] / np.sqrt(values[::-1][:LATENT_SIZE])
        return mean, np.ascontiguousarray((frames.T @ leading).T)

    def reference(self, arrays: MotionArrays, name: str) -> InComponents:
        """A sequence's offsets, aligned or true."""
        mean, directions = self.components
        flat = self._flat(arrays, name)
        squares = np.square(flat, dtype=np.float64).sum(axis=1)
        centred = flat - mean
        codes = (centred @ directions.T).astype(np.float64)
        left_out = np.square(centred, dtype=np.float64).sum(axis=1) - np.square(codes).sum(axis=1)
        return InComponents(codes, left_out, squares)

    def clips(self, split: Split) -> list[UnpaddedClip]:
        """Motions with coefficients in metres."""
        names = self._train if split == "train" else self._held_out
        aligned = self._aligned
        return [
            UnpaddedClip(
                join_inputs(aligned.frames("theta", name, slice(None)), aligned.betas(name)),
                self.reference(aligned, name).codes.astype(np.float32),
            )
            for name in names
        ]

    @staticmethod
    def _flat(arrays: MotionArrays, name: str) -> NDArray[np.float32]:
        offsets_m = arrays.frames("offsets", name, slice(None))
        return np.array(offsets_m).reshape(len(offsets_m), -1)


class PapersData(StudyData):
    """The paper's aligner's motions, and the latents of the run's autoencoder: what its own DSNet
    learns from."""

    def __init__(self, run: Run, decoder: Callable[[Artifact], Decode]) -> None:
        super().__init__(run, "align", "infer")
        stages = run.artifacts("encode", "train-ae")
        self._encode, self._decode = stages["encode"], decoder(stages["train-ae"])

    def identity(self) -> dict[str, Any]:
        """The latents too, which change with aligner and autoencoder."""
        known_mm = root_mean_square_mm(self.tested, KNOWN)
        return {"true_mm": known_mm, "encode_sha256": self._encode.content_sha256}

    def clips(self, split: Split) -> list[UnpaddedClip]:
        """Motions with latents."""
        return load_unpadded_clips(self._encode, split)

    def reference(self, arrays: MotionArrays, name: str) -> InOffsets:
        """A sequence's offsets, aligned or true."""
        return InOffsets(arrays, name, self._decode)
