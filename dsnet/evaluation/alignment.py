"""Errors of an alignment against the truth of synthetic data: pose, shape, translation, offsets.

Alignment can explain a jiggling breast by an offset or by a nodding spine (Section 6). With D the
true offset of a vertex in a frame, D' the estimated one and a = D - D' their difference, over any
set of vertices and frames,

    absorbed = sum a . D / sum |D|^2         0: all of D was recovered; 1: pose and shape absorb it
    invented = rms |D' - (1 - absorbed) D|   the part of the estimate that is not proportional to D

The invented part is orthogonal to D, so 1 - R2 = sum |a|^2 / sum |D|^2 = absorbed^2 +
sum |invented|^2 / sum |D|^2. R2 alone would not separate dynamics that were lost from errors that
are unrelated to them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.body import BodyModelData
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.motion import unpack_theta
from bridge.motion.cuts import turns_rad
from bridge.runs.workers import worker_pool
from dsnet.evaluation.metrics import ErrorSums, Sums, frame_blocks
from dsnet.evaluation.pipelines import MotionArrays

# Ratios of a body part are not given if it has less than this fraction of the body's energy.
_MIN_SHARE = 5e-3


@dataclass
class Absorption(Sums):
    """Absorbed and invented offsets of an alignment, from sums for each vertex.

    A vertex belongs to the body part of the joint with its largest skinning weight.
    """

    body: BodyModelData = field(metadata={"add": lambda body, _: body})
    frames: int = 0
    sums: NDArray[np.float64] = field(init=False)
    """(3, V) sums over frames of |D|^2, |a|^2 and a . D, square metres."""

    def __post_init__(self) -> None:
        self.sums = np.zeros((3, self.body.vertex_count))

    def add(self, estimated_m: ArrayLike, true_m: ArrayLike) -> None:
        """Add offsets (T, V, 3) of one sequence, metres."""
        true = np.asarray(true_m, dtype=np.float64)
        difference = true - np.asarray(estimated_m, dtype=np.float64)
        self.frames += len(true)
        pairs = (true, true), (difference, difference), (difference, true)
        self.sums += [np.einsum("tvx,tvx->v", *pair) for pair in pairs]

    def of(self, vertices: NDArray[np.bool_] | slice = slice(None)) -> dict[str, float | None]:
        """Errors over some vertices (V,) bool, or over all.

        `share` is the part of the body's true energy; `true_mm`, `error_mm` and `invented_mm` are
        root mean squares; `r2` and `absorbed` are None where hardly anything moves.
        """
        true, error, lost = (float(sums[vertices].sum()) for sums in self.sums)
        count = max(self.frames * len(self.sums[0, vertices]), 1)
        share = true / max(float(self.sums[0].sum()), np.finfo(float).tiny)
        moves = share >= _MIN_SHARE
        # Where hardly anything moves, the whole error is invented.
        invented = error - lost**2 / true if moves else error
        return {
            "share": share,
            "true_mm": 1e3 * float(np.sqrt(true / count)),
            "error_mm": 1e3 * float(np.sqrt(error / count)),
            "invented_mm": 1e3 * float(np.sqrt(max(invented, 0.0) / count)),
            "r2": 1.0 - error / true if moves else None,
            "absorbed": lost / true if moves else None,
        }

    def summary(self) -> dict[str, Any]:
        """The results of `of` for the `whole` body, and for `parts` by the name of SMPL's joint."""
        joint_of_vertex = self.body.weights.argmax(axis=1)
        parts = {
            name: self.of(vertices)
            for joint, name in enumerate(SMPL_JOINT_NAMES)
            if (vertices := joint_of_vertex == joint).any()
        }
        return {"whole": self.of(), "parts": parts}


Aligned = tuple[NDArray[np.floating], NDArray[np.floating]]
"""Theta (T, 69) of one sequence, and the offsets (T, V, 3) of its meshes from SMPL in the rest
pose, metres; may be memory-mapped."""


@dataclass
class AlignmentErrors(Sums):
    """Errors of an alignment against the truth; add one sequence after another."""

    absorption: Absorption
    offsets: ErrorSums = field(default_factory=ErrorSums)
    angles_deg: list[NDArray[np.float64]] = field(default_factory=list)
    shifts_mm: list[NDArray[np.float64]] = field(default_factory=list)

    def add(self, estimated: Aligned, true: Aligned) -> None:
        """Add one sequence."""
        (theta, offsets_m), (true_theta, true_offsets_m) = estimated, true
        for block in frame_blocks(slice(0, len(theta))):
            pair = offsets_m[block], true_offsets_m[block]
            self.offsets.add(*pair)
            self.absorption.add(*pair)
        pose, trans = unpack_theta(theta)
        true_pose, true_trans = unpack_theta(true_theta)
        self.angles_deg.append(np.degrees(turns_rad(pose, true_pose)))
        self.shifts_mm.append(1e3 * np.linalg.norm(trans - true_trans, axis=-1))

    def summary(self) -> dict[str, Any]:
        """Errors of `offsets`, `pose_deg` (over frames and joints) and `trans_mm`; `absorption`."""
        return {
            "offsets": self.offsets.summary(),
            "pose_deg": mean_and_p95(np.concatenate(self.angles_deg)),
            "trans_mm": mean_and_p95(np.concatenate(self.shifts_mm)),
            "absorption": self.absorption.summary(),
        }


def alignment_errors(
    align: MotionArrays, truth: MotionArrays | None, body: BodyModelData
) -> dict[str, Any]:
    """Errors of an alignment, for the manifest of `evaluate`.

    Always `frame_error_mm`, the distance of SMPL from the mesh; with a truth also the entries of
    `AlignmentErrors.summary`, and `betas_rms`, the root mean square error of the subjects' betas.
    """
    residual_mm = 1e3 * np.asarray(align.artifact.array("frame_error"), dtype=np.float64)
    fitted = {"frame_error_mm": mean_and_p95(residual_mm)}
    shared = [] if truth is None else [name for name in align.sequences if name in truth.sequences]
    if truth is None or not shared:
        return fitted

    def errors_of(body: BodyModelData, name: str) -> AlignmentErrors:
        # Compare total offsets: alignment cannot separate a static misfit from moving tissue.
        every = slice(None)
        estimated, true = (
            (arrays.frames("theta", name, every), arrays.offsets_m(name, every))
            for arrays in (align, truth)
        )
        errors = AlignmentErrors(Absorption(body))
        errors.add(estimated, true)
        return errors

    errors = AlignmentErrors(Absorption(body))
    with worker_pool("threads", body) as pool:
        for part in pool.map(errors_of, shared):
            errors += part
    # Each fitted shape once, however many sequences it serves.
    pairs = {(align.rows[name], truth.rows[name]) for name in shared}
    betas, true_betas = (arrays.artifact.array("betas") for arrays in (align, truth))
    differences = [betas[row] - true_betas[true_row] for row, true_row in sorted(pairs)]
    betas_rms = float(np.sqrt(np.mean(np.square(differences))))
    return fitted | errors.summary() | {"betas_rms": betas_rms}


def mean_and_p95(values: NDArray[np.floating]) -> dict[str, float]:
    """Mean and 95 % quantile."""
    return {"mean": float(values.mean()), "p95": float(np.quantile(values, 0.95))}
