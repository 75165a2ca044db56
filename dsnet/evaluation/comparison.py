"""Errors of all predictors on one sequence, of posed meshes and of offsets in the rest pose.

*Posed meshes* can be measured with licensed files too. With the beta' and theta' of its pipeline, a
prediction is the mesh M(beta', theta') + offset; "SMPL alone", whose R2 is 0, is M(beta', theta'),
and differs between pipelines. The reference is

- the registered mesh S_t for aligned sequences: M(beta', theta') + aligned offset is S_t exactly
  (Eq. 5), so the distance between skinned offsets is the distance between meshes;
- the true mesh M(beta, theta) + true offset for other synthetic sequences. A fitted beta' differs
  from the true beta, which adds to the error of the mesh.

*Offsets in the rest pose* are compared with the simulation's for synthetic data, so dynamics that
alignment put into pose and shape count as errors. For licensed files the reference is the aligned
offsets of the same pipeline. Where a truth has a `static` misfit beside the moving tissue, total,
static and moving part are compared, and velocities are those of the moving part. A predictor that
does not separate a static part is taken to predict the moving part only.
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
"""Key of the true offsets, among names of predictors."""
_VERTICES_AT_ONCE = 512


@dataclass
class SequenceErrors:
    """Errors on one sequence, by the name of the candidate."""

    sequence: MotionSequence
    errors: dict[str, Errors] = field(default_factory=dict)
    mesh_error_m: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    """(T,) error of the posed mesh in each frame, mean over its vertices."""
    offset_size_m: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    """(T,) mean length of the moving offsets in each frame, also of `TRUE`."""


class Evaluation:
    """Compares all candidates of one run, by sequence; the truth is None for licensed data."""

    def __init__(
        self, pipelines: Sequence[Pipeline], truth: MotionArrays | None, body: BodyModelData
    ) -> None:
        self._pipelines, self._truth, self._body = pipelines, truth, body
        self._smpl = Smpl(body, dtype=np.float64)
        self.candidates = candidates(pipelines)
        aligned = [s for pipeline in pipelines for s in pipeline.align.sequences.values()]
        self._subjects, self._motions = trained_people_and_kinds(aligned)

    def sequences(self) -> list[MotionSequence]:
        """Every sequence that a pipeline predicted, in the order of the first pipeline."""
        predicted: dict[str, MotionSequence] = {}
        for pipeline in self._pipelines:
            for name, sequence in pipeline.offsets.sequences.items():
                predicted.setdefault(name, sequence)
        return list(predicted.values())

    def is_training_subject(self, sequence: MotionSequence) -> bool:
        return sequence.subject in self._subjects

    def groups(self, sequence: MotionSequence) -> list[str]:
        """The split of a sequence; for a test sequence also its test group."""
        if sequence.split != "test":
            return [sequence.split]
        return ["test", cell_of(sequence, self._subjects, self._motions)]

    def compare(self, sequence: MotionSequence) -> SequenceErrors:
        """Errors of every candidate that has offsets of the sequence."""
        result = SequenceErrors(sequence)
        chosen = [one for one in self.candidates.values() if one.predicts(sequence.name)]
        result.errors = {one.name: {} for one in chosen}
        self._compare_meshes(result, [one for one in chosen if one.kind != SEQUENCE_MEAN])
        # SMPL alone has a mesh for each pipeline, but its offsets are zero in all of them.
        self._compare_offsets(result, [o for o in chosen if o.kind != SMPL or o.name == SMPL])
        result.errors = {name: errors for name, errors in result.errors.items() if errors}
        return result

    def _compare_meshes(self, result: SequenceErrors, chosen: Sequence[Candidate]) -> None:
        """Compare posed meshes with the registered mesh, or if it was not aligned the true one.

        Both sides are taken relative to SMPL alone, so that R2 is 0 for SMPL alone.
        """
        name, truth = result.sequence.name, self._truth
        registered = all(name in pipeline.align.sequences for pipeline in self._pipelines)
        if registered:
            truth = None
        elif truth is None or name not in truth.sequences:
            return
        pipelines = {one.pipeline.name: one.pipeline for one in chosen}.values()
        reference = [one.align for one in pipelines] if truth is None else [truth]
        compared = [*(one.motions for one in pipelines), *reference]
        means_m: dict[str, list[NDArray[np.float64]]] = {one.name: [] for one in chosen}
        sums = {one.name: ErrorSums() for one in chosen}
        for frames in frame_blocks(slice(0, min(one.sequences[name].length for one in compared))):
            # Pipelines often share betas and theta, and posing costs most: pose them once.
            cache: PosedCache = {}
            true_mesh_m = None
            if truth is not None:
                true = self._posed(truth, name, frames, cache)
                true_mesh_m = true.vertices_m + true.skinned(truth.offsets_m(name, frames))
            for pipeline in pipelines:
                smpl = self._posed(pipeline.motions, name, frames, cache)
                if true_mesh_m is None:
                    reference_m = smpl.skinned(pipeline.align.frames("offsets", name, frames))
                else:
                    reference_m = true_mesh_m - smpl.vertices_m
                for one in (one for one in chosen if one.pipeline is pipeline):
                    is_smpl = one.kind == SMPL
                    predicted_m = 0.0 if is_smpl else smpl.skinned(one.offsets_m(name, frames))
                    distance_m = sums[one.name].add(predicted_m, reference_m)
                    means_m[one.name].append(distance_m.mean(axis=1))
        for candidate, parts_m in means_m.items():
            if parts_m:
                result.errors[candidate]["mesh"] = sums[candidate]
                result.mesh_error_m[candidate] = np.concatenate(parts_m).astype(np.float32)

    def _posed(
        self, arrays: MotionArrays, name: str, frames: slice, cache: PosedCache
    ) -> PosedFrames:
        betas, theta = arrays.betas(name), arrays.frames("theta", name, frames)
        key = betas.tobytes(), theta.tobytes()
        if key not in cache:
            motion = unpack_theta(np.asarray(theta, dtype=np.float64))
            cache[key] = PosedFrames(*self._smpl.person(betas).skin(*motion))
        return cache[key]

    def _compare_offsets(self, result: SequenceErrors, chosen: Sequence[Candidate]) -> None:
        """Compare offsets with the true ones; without a truth, with the aligned ones."""
        name, truth = result.sequence.name, self._truth
        if truth is not None and name in truth.sequences:
            self._compare_with(result, truth, chosen)
            return
        for pipeline in {one.pipeline.name: one.pipeline for one in chosen}.values():
            if name in pipeline.align.sequences:
                of_pipeline = [one for one in chosen if one.pipeline is pipeline]
                self._compare_with(result, pipeline.align, of_pipeline)

    def _compare_with(
        self, result: SequenceErrors, reference: MotionArrays, chosen: Sequence[Candidate]
    ) -> None:
        name = result.sequence.name
        lengths = (one.pipeline.offsets.sequences[name].length for one in chosen)
        frames = slice(0, min(reference.sequences[name].length, *lengths))
        fps, vertices = reference.sequences[name].fps, self._body.vertex_count
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
                add_errors(result.errors[one.name], errors)
                if one.moves:
                    sizes_m[one.name] += _sizes_m(predicted)
        if TRUE in result.offset_size_m:  # with several alignments, keep the first one's offsets
            del sizes_m[TRUE]
        means_m = {key: size_m / vertices for key, size_m in sizes_m.items()}
        result.offset_size_m |= {key: mean_m.astype(np.float32) for key, mean_m in means_m.items()}


def rest_pose_errors(predicted: Offsets, true: Offsets, *, moves: bool) -> Errors:
    """Errors on some vertices; velocity and spectrum only if the predicted offsets change."""
    errors: Errors = {"offsets": ErrorSums.of(predicted.total_m, true.total_m)}
    if true.static_m is not None:
        errors["moving"] = ErrorSums.of(predicted.moving_m, true.moving_m)
        if predicted.static_m is not None:
            errors["static"] = ErrorSums.of(predicted.static_m, true.static_m)
    if moves:
        errors["velocity"] = VelocitySums.of(predicted, true)
        errors["spectrum"] = SpectrumSums.of(predicted, true)
    return errors


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
    """SMPL's posed mesh in some frames, and the transforms that skin offsets."""

    vertices_m: NDArray[np.float64]
    """(B, V, 3) M(beta, theta), without offsets."""
    linear: NDArray[np.float64]
    """(B, V, 3, 3) linear part of each vertex's skinning transform (Eq. 1)."""

    def skinned(self, offsets_m: ArrayLike) -> NDArray[np.float64]:
        """(B, V, 3) displacement of the posed mesh by offsets (B or 1, V, 3) of the rest pose.

        Skinning is affine: M(beta, theta) + offset is `vertices_m + skinned(offset)`.
        """
        # Storing each component contiguously makes NumPy loop over vertices instead of over three
        # coordinates, which is ten times faster.
        components = np.moveaxis(np.asarray(offsets_m), -1, 0).astype(np.float64, order="C")
        return np.einsum("bvxy,bvy->bvx", self.linear, np.moveaxis(components, 0, -1))


PosedCache = dict[tuple[bytes, bytes], PosedFrames]
"""Posed frames by the bytes of betas and theta."""
