"""What every predictor's errors on one sequence are: a row of the table that evaluation makes.

*Posed meshes* are what a user sees, and a user of licensed files can measure them too. With beta'
and theta' as its pipeline was given them, a prediction is the mesh M(beta', theta') + offset; "SMPL
alone", whose R2 is 0, is M(beta', theta'), another mesh in each pipeline. It is held against

- the registered mesh S_t, for sequences that were aligned: M(beta', theta') + aligned offset is
  S_t exactly (Eq. 5), so that the distance of the offsets, carried by skinning, is that of meshes;
- the true mesh M(beta, theta) + true offset, for synthetic sequences that were not. Where beta' was
  fitted it is not the true beta, and the offsets of the two differ by that in the rest pose.

*Offsets in the rest pose* are held against the simulation's for synthetic data, so that what
alignment put into pose and shape counts as lost; of licensed files only the aligned offsets are
known, each pipeline's own. Where a truth has a `static` misfit beside the moving tissue, the two
are judged together and apart, and movement is judged on what moves. Of a predictor that tells no
static part, all is taken to move.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.body import BodyModelData
from bridge.body.posing import Smpl
from bridge.motion import MotionSequence, unpack_theta
from bridge.motion.splits import cell_of, trained_people_and_kinds
from dsnet.evaluation.metrics import (
    Errors,
    ErrorSums,
    Offsets,
    SpectrumSums,
    VelocitySums,
    add_errors,
    frame_blocks,
)
from dsnet.evaluation.pipelines import (
    SEQUENCE_MEAN,
    SMPL,
    Candidate,
    MotionArrays,
    Pipeline,
    candidates,
)

TRUE = "true"
"""In place of a predictor's name: the true offsets."""
_VERTICES_AT_ONCE = 512


@dataclass
class SequenceErrors:
    """One sequence; by name of candidate what could be compared."""

    sequence: MotionSequence
    errors: dict[str, Errors] = field(default_factory=dict)
    mesh_error_m: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    """(T,) error of the posed mesh in each frame, mean over its vertices."""
    offset_size_m: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    """(T,) mean length of the moving offsets in each frame; of what moves, and of `TRUE`."""


class Evaluation:
    """All comparisons of one run; the truth is None for licensed data.

    Sequences are independent of one another.
    """

    def __init__(
        self, pipelines: Sequence[Pipeline], truth: MotionArrays | None, body: BodyModelData
    ) -> None:
        self._pipelines, self._truth, self._body = pipelines, truth, body
        self._smpl = Smpl(body, dtype=np.float64)
        self.candidates = candidates(pipelines)
        trained = [s for pipeline in pipelines for s in pipeline.align.places.values()]
        self._people, self._kinds = trained_people_and_kinds(trained)

    def sequences(self) -> list[MotionSequence]:
        """Every sequence that some pipeline predicted, the first one's in their order first."""
        found: dict[str, MotionSequence] = {}
        for pipeline in self._pipelines:
            for name, place in pipeline.offsets.places.items():
                found.setdefault(name, place)
        return list(found.values())

    def knows(self, sequence: MotionSequence) -> bool:
        return sequence.subject in self._people

    def groups(self, sequence: MotionSequence) -> list[str]:
        """Groups of sequences that it belongs to: those of a test have a second one."""
        if sequence.split != "test":
            return [sequence.split]
        return ["test", cell_of(sequence, self._people, self._kinds)]

    def compare(self, sequence: MotionSequence) -> SequenceErrors:
        found = SequenceErrors(sequence)
        chosen = [one for one in self.candidates.values() if one.predicts(sequence.name)]
        found.errors = {one.name: {} for one in chosen}
        self._compare_meshes(found, [one for one in chosen if one.kind != SEQUENCE_MEAN])
        # No offset is the same in every pipeline, while SMPL's mesh is not.
        self._compare_offsets(found, [o for o in chosen if o.kind != SMPL or o.name == SMPL])
        found.errors = {name: errors for name, errors in found.errors.items() if errors}
        return found

    def _compare_meshes(self, found: SequenceErrors, chosen: Sequence[Candidate]) -> None:
        """With what SMPL alone lacks of the registered mesh, of the true one without alignment."""
        name, truth = found.sequence.name, self._truth
        registered = all(name in pipeline.align.places for pipeline in self._pipelines)
        if registered:
            truth = None
        elif truth is None or name not in truth.places:
            return
        pipelines = {one.pipeline.name: one.pipeline for one in chosen}.values()
        reference = [one.align for one in pipelines] if truth is None else [truth]
        compared = [*(one.motions for one in pipelines), *reference]
        means_m: dict[str, list[NDArray[np.float64]]] = {one.name: [] for one in chosen}
        sums = {one.name: ErrorSums() for one in chosen}
        for frames in frame_blocks(slice(0, min(one.places[name].length for one in compared))):
            # A new person is the same everywhere, and posing is what costs most.
            posed: Posed = {}
            real_m = None
            if truth is not None:
                real = self._posed(truth, name, frames, posed)
                real_m = real.vertices_m + real.carried(truth.offsets_m(name, frames))
            for pipeline in pipelines:
                alone = self._posed(pipeline.motions, name, frames, posed)
                if real_m is None:
                    lacking_m = alone.carried(pipeline.align.frames("offsets", name, frames))
                else:
                    lacking_m = real_m - alone.vertices_m
                for one in (one for one in chosen if one.pipeline is pipeline):
                    still = one.kind == SMPL
                    added_m = 0.0 if still else alone.carried(one.offsets_m(name, frames))
                    distance_m = sums[one.name].add(added_m, lacking_m)
                    means_m[one.name].append(distance_m.mean(axis=1))
        for candidate, parts_m in means_m.items():
            if parts_m:
                found.errors[candidate]["mesh"] = sums[candidate]
                found.mesh_error_m[candidate] = np.concatenate(parts_m).astype(np.float32)

    def _posed(self, arrays: MotionArrays, name: str, frames: slice, known: Posed) -> PosedFrames:
        betas, theta = arrays.betas(name), arrays.frames("theta", name, frames)
        key = betas.tobytes(), theta.tobytes()
        if key not in known:
            motion = unpack_theta(np.asarray(theta, dtype=np.float64))
            known[key] = PosedFrames(*self._smpl.person(betas).skin(*motion))
        return known[key]

    def _compare_offsets(self, found: SequenceErrors, chosen: Sequence[Candidate]) -> None:
        name, truth = found.sequence.name, self._truth
        if truth is not None and name in truth.places:
            self._compare_with(found, truth, chosen)
            return
        for pipeline in {one.pipeline.name: one.pipeline for one in chosen}.values():
            if name in pipeline.align.places:
                own = [one for one in chosen if one.pipeline is pipeline]
                self._compare_with(found, pipeline.align, own)

    def _compare_with(
        self, found: SequenceErrors, reference: MotionArrays, chosen: Sequence[Candidate]
    ) -> None:
        name = found.sequence.name
        lengths = (one.pipeline.offsets.places[name].length for one in chosen)
        frames = slice(0, min(reference.places[name].length, *lengths))
        fps, vertices = reference.places[name].fps, self._body.vertex_count
        sizes_m = {one.name: np.zeros(frames.stop) for one in chosen if one.moves}
        sizes_m[TRUE] = np.zeros(frames.stop)
        for piece in frame_blocks(slice(0, vertices), _VERTICES_AT_ONCE):
            total_m = _single(reference.offsets_m(name, frames, piece))
            static = reference.has("static")
            static_m = _single(reference.frames("static", name, frames, piece)) if static else None
            true = Offsets(total_m, fps, static_m)
            sizes_m[TRUE] += _sizes_m(true)
            for one in chosen:
                predicted = _predicted(one, name, frames, piece, true)
                errors = rest_pose_errors(predicted, true, moves=one.moves)
                add_errors(found.errors[one.name], errors)
                if one.moves:
                    sizes_m[one.name] += _sizes_m(predicted)
        if TRUE in found.offset_size_m:  # of several alignments the first stands for the truth
            del sizes_m[TRUE]
        means_m = {key: size_m / vertices for key, size_m in sizes_m.items()}
        found.offset_size_m |= {key: mean_m.astype(np.float32) for key, mean_m in means_m.items()}


def rest_pose_errors(predicted: Offsets, true: Offsets, *, moves: bool) -> Errors:
    """Errors on some vertices; a predictor whose offsets do not change has no movement to judge."""
    found: Errors = {"offsets": ErrorSums.of(predicted.total_m, true.total_m)}
    if true.static_m is not None:
        found["moving"] = ErrorSums.of(predicted.moving_m, true.moving_m)
        if predicted.static_m is not None:
            found["static"] = ErrorSums.of(predicted.static_m, true.static_m)
    if moves:
        found["velocity"] = VelocitySums.of(predicted, true)
        found["spectrum"] = SpectrumSums.of(predicted, true)
    return found


def _predicted(one: Candidate, name: str, frames: slice, vertices: slice, true: Offsets) -> Offsets:
    static_m = None
    if one.kind == SEQUENCE_MEAN:
        offsets_m = true.total_m.mean(axis=0, dtype=np.float64)
    else:
        offsets_m = one.offsets_m(name, frames, vertices)
        static_m = one.static_m(name, frames, vertices)
    total_m = np.broadcast_to(_single(offsets_m), true.total_m.shape)
    return Offsets(total_m, true.fps, None if static_m is None else _single(static_m))


def _sizes_m(offsets: Offsets) -> NDArray[np.float64]:
    """(T,) length of the moving offsets, summed over vertices, metres."""
    return np.linalg.norm(offsets.moving_m, axis=-1).sum(axis=1, dtype=np.float64)


def _single(offsets_m: NDArray) -> NDArray[np.float32]:
    return np.ascontiguousarray(offsets_m, dtype=np.float32)


@dataclass(frozen=True)
class PosedFrames:
    """SMPL's mesh in some frames, and how it takes offsets along."""

    vertices_m: NDArray[np.float64]
    """(B, V, 3) M(beta, theta), without offsets."""
    linear: NDArray[np.float64]
    """(B, V, 3, 3) linear part of each vertex's skinning transform (Eq. 1)."""

    def carried(self, offsets_m: ArrayLike) -> NDArray[np.float64]:
        """(B, V, 3) what offsets (B or 1, V, 3) of the rest pose add to the posed mesh.

        Skinning is affine: M(beta, theta) + offset is `vertices_m + carried(offset)`.
        """
        # Each component's values side by side in memory: NumPy's loops then run along vertices
        # instead of along three coordinates, ten times faster.
        components = np.moveaxis(np.asarray(offsets_m), -1, 0).astype(np.float64, order="C")
        return np.einsum("bvxy,bvy->bvx", self.linear, np.moveaxis(components, 0, -1))


Posed = dict[tuple[bytes, bytes], PosedFrames]
"""By shape and motion."""
