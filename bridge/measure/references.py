"""What predictions are compared with: posed meshes, and for synthetic data the true offsets.

`mesh` asks what a user sees, and a user of licensed files can ask it too. With beta' and theta as
`predict` was given them, a prediction is the mesh M(beta', theta) + offset; "SMPL alone" is
M(beta', theta). It is held against

- the registered mesh S_t, for sequences that were aligned: M(beta', theta') + aligned offset is
  S_t exactly (Eq. 5), so that the distance of the offsets, carried by skinning, is that of meshes;
- the true mesh M(beta, theta) + true offset, for unseen motions of synthetic data. Where beta' was
  fitted it is not the true beta, and the offsets of the two cannot be compared in the rest pose.

`true_offsets` asks, for aligned sequences of synthetic data, what of the simulated soft tissue
comes back at rest: here all that alignment put into pose and shape counts as lost.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.measure.metrics import frame_blocks
from bridge.measure.posed_meshes import PosedBody, by_component
from bridge.motion import MotionSequence, sequences_of, subject_rows
from bridge.runs import Artifact


@dataclass(frozen=True)
class MotionArrays:
    """An artifact's theta, betas and perhaps offsets, by name of sequence."""

    artifact: Artifact
    places: Mapping[str, MotionSequence]

    @classmethod
    def of(cls, artifact: Artifact) -> MotionArrays:
        """Index an artifact."""
        return cls(artifact, {sequence.name: sequence for sequence in sequences_of(artifact)})

    def betas(self, name: str) -> NDArray:
        """(10,) shape of the sequence's person."""
        row = subject_rows(self.places.values())[self.places[name].subject]
        return self.artifact.array("betas")[row]

    def frames(self, array: str, name: str, block: slice) -> NDArray:
        """Rows of an array, counted from the sequence's first frame."""
        start = self.places[name].start
        return self.artifact.array(array)[start + block.start : start + block.stop]


class Carry(Protocol):
    """Brings offsets (B or 1, V, 3) of the rest pose to where they are compared, (B, V, 3)."""

    def __call__(self, offsets_m: NDArray, /) -> NDArray[np.float64]:
        """Carry them."""
        ...


@dataclass(frozen=True)
class Block:
    """Some frames of one comparison."""

    frames: slice
    """Counted from the sequence's first."""
    lacking_m: NDArray[np.float64]
    """(B, V, 3) what SMPL alone lacks: the carried offset that leaves no error."""
    carry: Carry
    """See `Carry`."""


class References:
    """The comparisons that a run's data allow.

    Parameters
    ----------
    body : the run's body model.
    predict, align : artifacts of these stages.
    truth : artifact of the simulation, None for licensed data.
    """

    def __init__(
        self, body: BodyModelData, predict: Artifact, align: Artifact, truth: Artifact | None
    ) -> None:
        self._body = body
        self._predict, self._align = MotionArrays.of(predict), MotionArrays.of(align)
        self._truth = None if truth is None else MotionArrays.of(truth)

    def of(self, name: str) -> list[str]:
        """Names of the references of a sequence, none for unseen motions without a truth."""
        known = self._truth is not None and name in self._truth.places
        if name in self._align.places:
            return ["mesh", "true_offsets"] if known else ["mesh"]
        return ["mesh"] if known else []

    def blocks(self, name: str, reference: str) -> Iterator[Block]:
        """All frames that predictions and reference share, in pieces."""
        if reference == "mesh" and name in self._align.places:
            return self._to_registered_mesh(name)
        if self._truth is None:
            raise KeyError(f"{name} has no reference {reference}")
        compare = self._to_true_mesh if reference == "mesh" else self._to_true_offsets
        return compare(name, self._truth)

    def _to_true_offsets(self, name: str, truth: MotionArrays) -> Iterator[Block]:
        for frames in self._shared(name, truth):
            offsets_m = by_component(truth.frames("offsets", name, frames))
            yield Block(frames, offsets_m, partial(_at_rest, shape=offsets_m.shape))

    def _to_registered_mesh(self, name: str) -> Iterator[Block]:
        person = PosedBody(self._body, self._predict.betas(name))
        for frames in self._shared(name, self._align):
            posed = person.pose(self._predict.frames("theta", name, frames))
            offsets_m = self._align.frames("offsets", name, frames)
            yield Block(frames, posed.carried(offsets_m), posed.carried)

    def _to_true_mesh(self, name: str, truth: MotionArrays) -> Iterator[Block]:
        given = PosedBody(self._body, self._predict.betas(name))
        true = PosedBody(self._body, truth.betas(name))
        for frames in self._shared(name, truth):
            posed = given.pose(self._predict.frames("theta", name, frames))
            real = true.pose(truth.frames("theta", name, frames))
            mesh_m = real.vertices_m + real.carried(truth.frames("offsets", name, frames))
            yield Block(frames, mesh_m - posed.vertices_m, posed.carried)

    def _shared(self, name: str, other: MotionArrays) -> Iterator[slice]:
        length = min(self._predict.places[name].length, other.places[name].length)
        return frame_blocks(slice(0, length))


def _at_rest(offsets_m: NDArray, shape: tuple[int, ...]) -> NDArray[np.float64]:
    return np.broadcast_to(by_component(offsets_m), shape)


def best_constant_m(blocks: Iterable[Block]) -> NDArray[np.float64]:
    """(V, 3) the constant offset with the least squared error: an oracle, it knows the reference.

    Of offsets compared at rest that is their mean.
    """
    normal, right = 0.0, 0.0
    for block in blocks:
        # What skinning makes of the three unit offsets: the columns of its linear part.
        units = np.broadcast_to(np.eye(3)[:, None, None], (3, 1, *block.lacking_m.shape[1:]))
        columns = [block.carry(unit) for unit in units]
        normal = normal + np.array(
            [[np.einsum("bvy,bvy->v", one, other) for other in columns] for one in columns]
        )
        right = right + np.array([np.einsum("bvy,bvy->v", c, block.lacking_m) for c in columns])
    normal, right = np.moveaxis(np.asarray(normal), -1, 0), np.asarray(right).T[..., None]
    return np.linalg.solve(normal, right)[..., 0]
