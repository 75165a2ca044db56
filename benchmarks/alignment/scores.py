"""What an estimate is worth when the truth is known; the same figures for every aligner."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks.alignment.contenders import Estimate
from benchmarks.alignment.joint_absorption import CARRIERS, JointLoads, pose_error
from benchmarks.alignment.known_sequences import KnownSequence
from bridge.body import BodyModelData, load_body_model, pose_vertices
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.motion import unpack_theta
from bridge.paper import N_JOINTS
from dsnet.evaluation.alignment import Absorption, AlignmentErrors, mean_and_p95
from torch_align_ae.body import SMPL, rest_pose_offsets

_TOES = [SMPL_JOINT_NAMES.index(name) for name in ("left_foot", "right_foot")]


class Scores:
    """Errors of one aligner, sequence by sequence."""

    def __init__(self) -> None:
        # Both bodies have the same vertices in the same parts: sums over genders have a meaning.
        self.errors = AlignmentErrors(Absorption(body_of("female")))
        self.r2_of_sequence: dict[str, float] = {}
        self._residuals_m: list[NDArray[np.float32]] = []
        self._turns: list[NDArray[np.float64]] = []
        self._betas_squared: list[float] = []
        self._work = np.zeros(len(CARRIERS))

    def add(self, known: KnownSequence, loads: JointLoads, estimate: Estimate) -> None:
        """Take in one sequence; `loads` are those of its true offsets."""
        offsets_m, residual_m = _unpose(known, estimate)
        errors = AlignmentErrors(Absorption(body_of(known.recording.gender)))
        errors.add((estimate.theta, offsets_m), (known.theta, known.offsets_m))
        self.errors += errors
        self.r2_of_sequence[known.recording.name] = errors.offsets.r2
        self._residuals_m.append(residual_m)
        self._turns.append(pose_error(estimate.theta, known.theta)[0])
        self._betas_squared.append(float(np.mean(np.square(estimate.betas - known.betas))))
        self._work += loads.work(estimate.theta)

    def summary(self) -> dict[str, Any]:
        """Figures for the table and the results file."""
        turns = np.concatenate(self._turns)
        energy = self.errors.offsets.squared_reference
        rms_deg = np.degrees(np.sqrt(np.square(turns).sum(-1).mean(0)))
        shares = dict(zip(CARRIERS, (self._work / energy).tolist(), strict=True))
        joints = {name: {"absorbed": share} for name, share in shares.items()}
        for name, angle in zip(CARRIERS[:N_JOINTS], rms_deg.tolist(), strict=True):
            joints[name]["rms_deg"] = angle
        worst = min(self.r2_of_sequence, key=self.r2_of_sequence.__getitem__)
        return {
            "r2": self.errors.offsets.r2,
            "r2_worst": self.r2_of_sequence[worst],
            "worst_sequence": worst,
            "r2_without_toes": self.errors.absorption.of(~moved_by_toes())["r2"],
            "residual_mm": mean_and_p95(1e3 * np.concatenate(self._residuals_m)),
            "betas_rms": float(np.sqrt(np.mean(self._betas_squared))),
            **self.errors.summary(),
            "joints": joints,
            "r2_of_sequence": self.r2_of_sequence,
        }


def loads_of(known: KnownSequence) -> JointLoads:
    """The true offsets' torques, against which every aligner's errors do their work."""
    body, recording = body_of(known.recording.gender), known.recording
    return JointLoads.of(body, known.betas, known.theta, known.offsets_m, recording.meshes_m)


def moved_by_toes() -> NDArray[np.bool_]:
    """(V,) vertices that move by 0.1 mm or more when the toes, which smplfitter never turns,
    turn by half a radian."""
    pose = np.zeros((2, N_JOINTS, 3))
    pose[1, _TOES, 0] = -0.5
    flat, raised = pose_vertices(body_of("female"), np.zeros((2, 10)), pose, np.zeros((2, 3)))
    return np.linalg.norm(raised - flat, axis=-1) > 1e-4


@cache
def body_of(gender: str) -> BodyModelData:
    """The embedded body."""
    return load_body_model(f"embedded:{gender}")


@cache
def _smpl(gender: str) -> SMPL:
    return SMPL(body_of(gender))


def _unpose(
    known: KnownSequence, estimate: Estimate
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Eq. 5: offsets (T, V, 3) m, and the posed body's mean distance from the mesh (T,) m."""
    meshes = torch.from_numpy(known.recording.meshes_m)
    pose, trans = (torch.from_numpy(part.copy()) for part in unpack_theta(estimate.theta))
    betas = torch.from_numpy(estimate.betas).expand(len(meshes), -1)
    with torch.inference_mode():
        offsets, distance = rest_pose_offsets(
            _smpl(known.recording.gender), meshes, betas, pose, trans
        )
    return offsets.numpy(), distance.mean(1).numpy()
