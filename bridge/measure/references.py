"""What posed predictions are compared with, a few frames at a time.

This asks what a user sees, and a user of licensed files can ask it too. With beta' and theta' as
its road was given them, a prediction is the mesh M(beta', theta') + offset; "SMPL alone" is
M(beta', theta'). It is held against

- the registered mesh S_t, for sequences that were aligned: M(beta', theta') + aligned offset is
  S_t exactly (Eq. 5), so that the distance of the offsets, carried by skinning, is that of meshes;
- the true mesh M(beta, theta) + true offset, for unseen motions of synthetic data. Where beta' was
  fitted it is not the true beta, and the offsets of the two differ by that in the rest pose.

Roads have motions and shapes of their own, so SMPL alone, whose R2 is 0, is another mesh
on each.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.posing import ShapedBody, Smpl
from bridge.measure.metrics import frame_blocks
from bridge.measure.posed_meshes import PosedFrames, posed_frames
from bridge.measure.roads import Road
from bridge.motion import MotionSequence, sequences_of, subject_rows
from bridge.runs import Artifact


@dataclass(frozen=True)
class MotionArrays:
    """An artifact's theta, betas and perhaps offsets, by name of sequence."""

    artifact: Artifact
    places: Mapping[str, MotionSequence]
    rows: Mapping[str, int]
    """Of people in `betas`."""

    @classmethod
    def of(cls, artifact: Artifact) -> MotionArrays:
        """Index an artifact."""
        sequences = sequences_of(artifact)
        places = {sequence.name: sequence for sequence in sequences}
        return cls(artifact, places, subject_rows(sequences))

    def betas(self, name: str) -> NDArray:
        """(10,) shape of the sequence's person."""
        return self.artifact.array("betas")[self.rows[self.places[name].subject]]

    def frames(self, array: str, name: str, block: slice, vertices: slice = slice(None)) -> NDArray:
        """Rows of an array, counted from the sequence's first frame."""
        start = self.places[name].start
        return self.artifact.array(array)[start + block.start : start + block.stop][:, vertices]

    def has(self, array: str) -> bool:
        """Whether the artifact holds an array."""
        return array in self.artifact.manifest["arrays"]


@dataclass(frozen=True)
class Block:
    """Some frames of one sequence on one road."""

    frames: slice
    """Counted from the sequence's first."""
    lacking_m: NDArray[np.float64]
    """(B, V, 3) what SMPL alone lacks: the carried offset that leaves no error."""
    posed: PosedFrames
    """SMPL alone, and how it carries offsets."""


class References:
    """The meshes that a run's data allow to compare with.

    Parameters
    ----------
    body : the run's body model.
    truth : artifact of the simulation, None for licensed data.
    """

    def __init__(
        self, body: BodyModelData, roads: Sequence[Road], truth: MotionArrays | None
    ) -> None:
        self._body, self._truth = body, truth
        self._given = {road.name: MotionArrays.of(road.motions) for road in roads}
        self._aligned = {road.name: MotionArrays.of(road.align) for road in roads}

    def has(self, name: str) -> bool:
        """Whether a sequence can be compared: an unseen motion only with a truth."""
        return self._is_aligned(name) or self._is_known(name)

    def blocks(self, name: str, roads: Sequence[str]) -> Iterator[dict[str, Block]]:
        """All frames that the roads and the reference share, in pieces, by road."""
        arrays = [self._given[road] for road in roads]
        if self._is_aligned(name):
            return self._to_registered_mesh(name, roads, arrays)
        if self._truth is None:
            raise KeyError(f"{name} has no reference")
        return self._to_true_mesh(name, roads, arrays, self._truth)

    def _is_aligned(self, name: str) -> bool:
        return all(name in arrays.places for arrays in self._aligned.values())

    def _is_known(self, name: str) -> bool:
        return self._truth is not None and name in self._truth.places

    def _to_registered_mesh(
        self, name: str, roads: Sequence[str], given: Sequence[MotionArrays]
    ) -> Iterator[dict[str, Block]]:
        poser = _Poser(self._body)
        aligned = [self._aligned[road] for road in roads]
        for frames in _shared(name, [*given, *aligned]):
            found = {}
            for road, arrays, own in zip(roads, given, aligned, strict=True):
                posed = poser.pose(arrays, name, frames)
                lacking_m = posed.carried(own.frames("offsets", name, frames))
                found[road] = Block(frames, lacking_m, posed)
            yield found

    def _to_true_mesh(
        self,
        name: str,
        roads: Sequence[str],
        given: Sequence[MotionArrays],
        truth: MotionArrays,
    ) -> Iterator[dict[str, Block]]:
        poser = _Poser(self._body)
        for frames in _shared(name, [*given, truth]):
            real = poser.pose(truth, name, frames)
            mesh_m = real.vertices_m + real.carried(true_offsets_m(truth, name, frames))
            found = {}
            for road, arrays in zip(roads, given, strict=True):
                posed = poser.pose(arrays, name, frames)
                found[road] = Block(frames, mesh_m - posed.vertices_m, posed)
            yield found


class _Poser:
    """Poses the frames of one sequence, each shape and motion once.

    A new person has the same on every road and in the truth, and posing is what costs most.
    """

    def __init__(self, body: BodyModelData) -> None:
        self._smpl = Smpl(body, dtype=np.float64)
        self._people: dict[bytes, ShapedBody] = {}
        self._posed: dict[tuple[bytes, bytes], PosedFrames] = {}
        self._frames: slice | None = None

    def pose(self, arrays: MotionArrays, name: str, frames: slice) -> PosedFrames:
        """SMPL alone in some frames; only the last frames asked for are kept."""
        if frames != self._frames:
            self._frames, self._posed = frames, {}
        betas, theta = arrays.betas(name), arrays.frames("theta", name, frames)
        person = betas.tobytes()
        if person not in self._people:
            self._people[person] = self._smpl.person(betas)
        key = person, theta.tobytes()
        if key not in self._posed:
            self._posed[key] = posed_frames(self._people[person], theta)
        return self._posed[key]


def true_offsets_m(
    truth: MotionArrays, name: str, frames: slice, vertices: slice = slice(None)
) -> NDArray:
    """(B, V, 3) all that the true mesh has over SMPL: what moves, and `static` if there is one."""
    moving_m = truth.frames("offsets", name, frames, vertices)
    if not truth.has("static"):
        return moving_m
    return moving_m + truth.frames("static", name, frames, vertices)


def _shared(name: str, arrays: Sequence[MotionArrays]) -> Iterator[slice]:
    length = min(one.places[name].length for one in arrays)
    return frame_blocks(slice(0, length))
