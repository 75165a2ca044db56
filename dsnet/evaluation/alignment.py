"""What alignment gives back of what the meshes were made from; only synthetic data can tell.

Alignment can explain a jiggling breast by an offset or by a nodding spine (Section 6). With D the
true offset of a vertex in a frame, D' the estimated one and a = D - D' what became of the
difference,

    absorbed = sum a . D / sum |D|^2          0: all of D came back, 1: pose and shape took it all
    invented = rms |D' - (1 - absorbed) D|    what the estimate has that is not in proportion to D

over any set of vertices and frames. The two do not overlap: invented is perpendicular to D, so
1 - R2 = sum |a|^2 / sum |D|^2 = absorbed^2 + sum |invented|^2 / sum |D|^2. An energy ratio alone
would not tell dynamics that were lost from errors that have nothing to do with them.
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

# Of a part that holds less of the body's energy, no share can be told: it hardly moves.
_LEAST_SHARE = 5e-3


@dataclass
class Absorption(Sums):
    """Sums of one aligner's offsets against the true ones, for each vertex.

    A vertex belongs to the part of the joint with its largest weight.
    """

    body: BodyModelData = field(metadata={"add": lambda own, _: own})
    frames: int = 0
    sums: NDArray[np.float64] = field(init=False)
    """(3, V) of the true offsets, the error, and what was taken of the true ones, square metres."""

    def __post_init__(self) -> None:
        self.sums = np.zeros((3, self.body.vertex_count))

    def add(self, found_m: ArrayLike, true_m: ArrayLike) -> None:
        """Take in offsets (T, V, 3) of one sequence, metres."""
        true = np.asarray(true_m, dtype=np.float64)
        difference = true - np.asarray(found_m, dtype=np.float64)
        self.frames += len(true)
        pairs = (true, true), (difference, difference), (difference, true)
        self.sums += [np.einsum("tvx,tvx->v", *pair) for pair in pairs]

    def of(self, vertices: NDArray[np.bool_] | slice = slice(None)) -> dict[str, float | None]:
        """Figures of some vertices (V,) bool, or of all.

        `share` of the body's true energy; `true_mm`, `error_mm` and `invented_mm`, root mean
        squares; `r2`; `absorbed`. What would be a ratio to nothing is None.
        """
        true, error, taken = (float(sums[vertices].sum()) for sums in self.sums)
        count = max(self.frames * len(self.sums[0, vertices]), 1)
        share = true / max(float(self.sums[0].sum()), np.finfo(float).tiny)
        tells = share >= _LEAST_SHARE
        # Where hardly anything moves, all that the estimate has is invented.
        invented = error - taken**2 / true if tells else error
        return {
            "share": share,
            "true_mm": 1e3 * float(np.sqrt(true / count)),
            "error_mm": 1e3 * float(np.sqrt(error / count)),
            "invented_mm": 1e3 * float(np.sqrt(max(invented, 0.0) / count)),
            "r2": 1.0 - error / true if tells else None,
            "absorbed": taken / true if tells else None,
        }

    def summary(self) -> dict[str, Any]:
        """`whole` body, and `parts` by name in SMPL's order, as `of` gives them."""
        part_of_vertex = self.body.weights.argmax(axis=1)
        parts = {
            name: self.of(own)
            for joint, name in enumerate(SMPL_JOINT_NAMES)
            if (own := part_of_vertex == joint).any()
        }
        return {"whole": self.of(), "parts": parts}


Aligned = tuple[NDArray[np.floating], NDArray[np.floating]]
"""Theta (T, 69) of one sequence, and offsets (T, V, 3): all that the mesh has over SMPL, in the
rest pose, metres; may be memory-mapped."""


@dataclass
class AlignmentErrors(Sums):
    """Errors of what an aligner found with a body model, sequence by sequence."""

    absorption: Absorption
    offsets: ErrorSums = field(default_factory=ErrorSums)
    angles_deg: list[NDArray[np.float64]] = field(default_factory=list)
    shifts_mm: list[NDArray[np.float64]] = field(default_factory=list)

    def add(self, found: Aligned, true: Aligned) -> None:
        (theta, offsets_m), (true_theta, true_offsets_m) = found, true
        for block in frame_blocks(slice(0, len(theta))):
            pair = offsets_m[block], true_offsets_m[block]
            self.offsets.add(*pair)
            self.absorption.add(*pair)
        pose, trans = unpack_theta(theta)
        true_pose, true_trans = unpack_theta(true_theta)
        self.angles_deg.append(np.degrees(turns_rad(pose, true_pose)))
        self.shifts_mm.append(1e3 * np.linalg.norm(trans - true_trans, axis=-1))

    def summary(self) -> dict[str, Any]:
        """`pose_deg` is over frames and joints."""
        return {
            "offsets": self.offsets.summary(),
            "pose_deg": spread(np.concatenate(self.angles_deg)),
            "trans_mm": spread(np.concatenate(self.shifts_mm)),
            "absorption": self.absorption.summary(),
        }


def alignment_errors(
    align: MotionArrays, truth: MotionArrays | None, body: BodyModelData
) -> dict[str, Any]:
    """`frame_error_mm` of the aligned model, and with a truth also `AlignmentErrors.summary` and
    `betas_rms`, root mean square over the coefficients of the subjects.
    """
    residual_mm = 1e3 * np.asarray(align.artifact.array("frame_error"), dtype=np.float64)
    fitted = {"frame_error_mm": spread(residual_mm)}
    shared = [] if truth is None else [name for name in align.places if name in truth.places]
    if truth is None or not shared:
        return fitted

    def errors_of(body: BodyModelData, name: str) -> AlignmentErrors:
        # Alignment cannot tell a misfit that stays from flesh that moves, and is not asked to.
        every = slice(None)
        found, true = (
            (arrays.frames("theta", name, every), arrays.offsets_m(name, every))
            for arrays in (align, truth)
        )
        own = AlignmentErrors(Absorption(body))
        own.add(found, true)
        return own

    errors = AlignmentErrors(Absorption(body))
    with worker_pool("threads", body) as pool:
        for own in pool.map(errors_of, shared):
            errors += own
    found_betas, true_betas = (arrays.artifact.array("betas") for arrays in (align, truth))
    differences = [
        found_betas[row] - true_betas[truth.rows[subject]]
        for subject, row in align.rows.items()
        if subject in truth.rows
    ]
    betas_rms = float(np.sqrt(np.mean(np.square(differences))))
    return fitted | errors.summary() | {"betas_rms": betas_rms}


def spread(values: NDArray[np.floating]) -> dict[str, float]:
    return {"mean": float(values.mean()), "p95": float(np.quantile(values, 0.95))}
