"""What alignment gives back of what the meshes were made from; only synthetic data can tell."""

from __future__ import annotations

from typing import Any

import numpy as np

from bridge.exchange import Artifact, sequences_of, subject_rows, unpack_theta
from bridge.results.metrics import ErrorSums, frame_blocks, rotation_error_deg


def alignment_errors(align: Artifact, truth: Artifact | None) -> dict[str, Any]:
    """Fitting error of the aligned model and, with `truth`, errors of what it found.

    Returns
    -------
    dict
        `frame_error_mm` always; with truth `offsets` (as `ErrorSums.summary`), `pose_deg`
        and `trans_mm` (mean and 95th percentile over frames and joints), `betas` (root mean
        square over the coefficients of the subjects).
    """
    residual_mm = 1e3 * np.asarray(align.array("frame_error"), dtype=np.float64)
    errors: dict[str, Any] = {"frame_error_mm": _spread(residual_mm)}
    if truth is None:
        return errors
    known = {sequence.name: sequence for sequence in sequences_of(truth)}
    offsets, angles_deg, shifts_mm = ErrorSums(), [], []
    for sequence in sequences_of(align):
        if sequence.name not in known:
            continue
        shift = known[sequence.name].start - sequence.start
        for block in frame_blocks(sequence.frames):
            own = slice(block.start + shift, block.stop + shift)
            offsets.add(align.array("offsets")[block], truth.array("offsets")[own])
        own = known[sequence.name].frames
        pose, trans = unpack_theta(align.array("theta")[sequence.frames])
        true_pose, true_trans = unpack_theta(truth.array("theta")[own])
        angles_deg.append(rotation_error_deg(pose, true_pose).ravel())
        shifts_mm.append(1e3 * np.linalg.norm(trans - true_trans, axis=-1))
    if not angles_deg:
        return errors
    return errors | {
        "offsets": offsets.summary(),
        "pose_deg": _spread(np.concatenate(angles_deg)),
        "trans_mm": _spread(np.concatenate(shifts_mm)),
        "betas_rms": _beta_error(align, truth),
    }


def _spread(values: np.ndarray) -> dict[str, float]:
    return {"mean": float(values.mean()), "p95": float(np.quantile(values, 0.95))}


def _beta_error(align: Artifact, truth: Artifact) -> float:
    found, known = subject_rows(sequences_of(align)), subject_rows(sequences_of(truth))
    differences = [
        align.array("betas")[row] - truth.array("betas")[known[subject]]
        for subject, row in found.items()
        if subject in known
    ]
    return float(np.sqrt(np.mean(np.square(differences))))
