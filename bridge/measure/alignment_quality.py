"""What alignment gives back of what the meshes were made from; only synthetic data can tell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.measure.absorption import Absorption
from bridge.measure.metrics import ErrorSums, frame_blocks, rotation_error_deg
from bridge.measure.references import MotionArrays
from bridge.motion import unpack_theta
from bridge.runs import Artifact
from bridge.runs.workers import worker_pool


@dataclass(frozen=True)
class Alignment:
    """Shape, poses and offsets of one sequence, found or true."""

    betas: NDArray[np.floating]
    """(10,), or (T, 10) when each frame has its own."""
    theta: NDArray[np.floating]
    """(T, 69)."""
    offsets_m: NDArray[np.floating]
    """(T, V, 3) all that the mesh has over SMPL, in the rest pose; may be memory-mapped."""

    @classmethod
    def of(cls, arrays: MotionArrays, name: str) -> Alignment:
        """One sequence of an `align` artifact or of the truth."""
        artifact, frames = arrays.artifact, arrays.places[name].frames
        theta, offsets_m = (artifact.array(name)[frames] for name in ("theta", "offsets"))
        if arrays.has("static"):
            # Alignment cannot tell a misfit that stays from flesh that moves, and is not asked to.
            offsets_m = offsets_m + artifact.array("static")[frames]
        return cls(arrays.betas(name), theta, offsets_m)


class AlignmentErrors:
    """Errors of what an aligner found, sequence by sequence, against what is true.

    Parameters
    ----------
    body : the body model that the meshes were aligned with.
    """

    def __init__(self, body: BodyModelData) -> None:
        self.offsets, self.absorption = ErrorSums(), Absorption(body)
        self._angles_deg: list[NDArray[np.float64]] = []
        self._shifts_mm: list[NDArray[np.float64]] = []

    def add(self, found: Alignment, true: Alignment) -> None:
        """Take in one sequence, of as many frames in both."""
        for block in frame_blocks(slice(0, len(found.theta))):
            pair = found.offsets_m[block], true.offsets_m[block]
            self.offsets.add(*pair)
            betas = found.betas if found.betas.ndim == 1 else found.betas[block]
            self.absorption.add(*pair, betas, true.betas)
        pose, trans = unpack_theta(found.theta)
        true_pose, true_trans = unpack_theta(true.theta)
        self._angles_deg.append(rotation_error_deg(pose, true_pose))
        self._shifts_mm.append(1e3 * np.linalg.norm(trans - true_trans, axis=-1))

    def merge(self, other: AlignmentErrors) -> None:
        """Take in all sequences of `other`."""
        self.offsets.merge(other.offsets)
        self.absorption.merge(other.absorption)
        self._angles_deg += other._angles_deg
        self._shifts_mm += other._shifts_mm

    def summary(self) -> dict[str, Any]:
        """`offsets` as `ErrorSums.summary`; `pose_deg` (over frames and joints) and `trans_mm`,
        mean and 95th percentile; `absorption` as `Absorption.summary`.
        """
        return {
            "offsets": self.offsets.summary(),
            "pose_deg": spread(np.concatenate(self._angles_deg)),
            "trans_mm": spread(np.concatenate(self._shifts_mm)),
            "absorption": self.absorption.summary(),
        }


def alignment_errors(
    align: Artifact, truth: Artifact | None, body: BodyModelData
) -> dict[str, Any]:
    """Fitting error of the aligned model and, with `truth`, errors of what it found.

    Returns
    -------
    dict
        `frame_error_mm` always; with truth also what `AlignmentErrors.summary` gives, and
        `betas_rms` (root mean square over the coefficients of the subjects).
    """
    residual_mm = 1e3 * np.asarray(align.array("frame_error"), dtype=np.float64)
    fitted = {"frame_error_mm": spread(residual_mm)}
    if truth is None:
        return fitted
    found, true = MotionArrays.of(align), MotionArrays.of(truth)
    shared = [name for name in found.places if name in true.places]
    if not shared:
        return fitted

    def errors_of(body: BodyModelData, name: str) -> AlignmentErrors:
        own = AlignmentErrors(body)
        own.add(Alignment.of(found, name), Alignment.of(true, name))
        return own

    errors = AlignmentErrors(body)
    with worker_pool("threads", body) as pool:
        for own in pool.map(errors_of, shared):
            errors.merge(own)
    return fitted | errors.summary() | {"betas_rms": _beta_error(found, true)}


def spread(values: NDArray[np.floating]) -> dict[str, float]:
    """Mean and 95th percentile."""
    return {"mean": float(values.mean()), "p95": float(np.quantile(values, 0.95))}


def _beta_error(found: MotionArrays, true: MotionArrays) -> float:
    found_betas, true_betas = (arrays.artifact.array("betas") for arrays in (found, true))
    differences = [
        found_betas[row] - true_betas[true.rows[subject]]
        for subject, row in found.rows.items()
        if subject in true.rows
    ]
    return float(np.sqrt(np.mean(np.square(differences))))
