"""`python -m benchmarks.prediction.marker_pose --out DIR`: flesh on a pose that holds its bounce.

The packaged model moves the flesh of a sample motion; markers ride on that skin, and a pose is
fitted to all of them, as MoSh does. What the same model then predicts on the fitted pose, and on
that pose after `--pose bony`, is compared with the flesh that there was: on the true pose R2 is 1,
so all that is missing is the pose's fault. About a minute.
"""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from benchmarks.processes import run_as_process
from bridge.body import BodyModelData
from bridge.body.posing import Smpl, shaped_joints
from bridge.motion import Motion, load_motion, pack_theta, unpack_theta
from bridge.motion.motion import Y_UP_FROM_Z_UP
from bridge.motion.readers.amass import motion_path
from bridge.runs.files import write_text_atomically
from dsnet.markers.bone_pose import bone_pose_of
from dsnet.markers.segments import faster
from dsnet.prediction.load_model import TrainedModel, load_model
from dsnet.prediction.moving_body import MovingBody, place_motion

EMBEDDED_MARKERS = {
    "CLAV": 576, "C7": 245, "T8": 1810, "LBAK": 4033, "RBAK": 589, "STRN": 5347, "LBUST": 4250,
    "RBUSTLO": 834, "LPSI": 5442, "RPSI": 2046, "LASI": 5569, "RASI": 2228, "MBLLY": 5375,
    "LBUM": 5465, "LKNE": 5864, "RKNE": 2514, "LANK": 6682, "RANK": 3327, "LFTHI": 6888,
    "RTHI": 2166, "LTIB": 5993, "LFHD": 6206, "RFHD": 47, "LBHD": 3760, "RBHD": 305,
}  # fmt: skip
"""Vertices of the embedded woman where optical markers sit."""
_MARKERS = 67
_NOISE_M = 0.0005
_ROUNDS, _STEP = 4, 1e-4
_TURN_RAD, _MARKER_M = 0.1, 0.005
"""How far a joint is let go from its true angle, beside how far markers lie off: MoSh has a prior
of poses in its place, which knows less."""
_SMOOTH_HZ = 12.0


@dataclass(frozen=True)
class MarkerPoseConfig:
    """Measure two sample motions."""

    out: Path
    """Folder that receives marker_pose.json."""
    seed: int = 0
    """Of the markers' noise."""


def main(config: MarkerPoseConfig) -> dict[str, Any]:
    """Write the results; also returns them."""
    found = {name: _measured(name, config.seed) for name in ("jumping_jacks", "dancing")}
    config.out.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"seed": config.seed, "motions": found}, indent=1) + "\n"
    write_text_atomically(config.out / "marker_pose.json", text)
    return found


def _measured(name: str, seed: int) -> dict[str, dict[str, float]]:
    motion = load_motion(f"sample:{name}")
    trained = load_model(None, gender=motion.gender)
    body, true = trained.body, place_motion(motion, trained.body)
    offsets_m = _offsets(trained, true)
    vertices = _all_markers(body)
    ids = np.array(list(vertices.values()))
    person = Smpl(body, ids, np.float64).person(true.betas)
    skin = person.pose(*unpack_theta(true.theta), offsets_m[:, ids])
    seen = skin + _NOISE_M * np.random.default_rng(seed).standard_normal(skin.shape)
    fitted = replace(true, theta=_fitted(body, ids, true, seen))
    poses = {"pose fitted to all markers": fitted, "the same, bony": _bony(body, fitted, seen)}
    return {what: _scores(trained, true, offsets_m, pose) for what, pose in poses.items()}


def _offsets(trained: TrainedModel, motion: Motion) -> NDArray[np.float64]:
    found = [part.offsets_m for part in MovingBody(trained, motion)]
    return np.concatenate(found).astype(np.float64)


def _all_markers(body: BodyModelData) -> dict[str, int]:
    """The named ones, and others as far from all as can be."""
    found = dict(EMBEDDED_MARKERS)
    rest = body.v_template
    near = np.min([np.linalg.norm(rest - rest[v], axis=1) for v in found.values()], axis=0)
    while len(found) < _MARKERS:
        found[f"FAR{len(found)}X"] = far = int(near.argmax())
        near = np.minimum(near, np.linalg.norm(rest - rest[far], axis=1))
    return found


def _fitted(body: BodyModelData, ids: NDArray, true: Motion, seen: NDArray) -> NDArray:
    """(T, 69) least squares of pose and place to all markers, frame by frame, then smoothed."""
    person = Smpl(body, ids, np.float64).person(true.betas)
    theta = np.array(true.theta, np.float64)

    def places(at: NDArray) -> NDArray:
        return person.pose(*unpack_theta(at)).reshape(len(at), -1)

    weight = np.r_[np.full(theta.shape[1] - 3, (_MARKER_M / _TURN_RAD) ** 2), np.zeros(3)]
    for _ in range(_ROUNDS):
        here = places(theta)
        steps = (places(theta + _STEP * row) - here for row in np.eye(theta.shape[1]))
        slope = np.stack([step / _STEP for step in steps], axis=2)  # (T, 3 N, 69)
        square = np.einsum("tmi,tmj->tij", slope, slope) + np.diag(weight)
        pull = np.einsum("tmi,tm->ti", slope, seen.reshape(len(here), -1) - here)
        pull -= weight * (theta - true.theta)
        theta = theta + np.linalg.solve(square, pull[..., None])[..., 0]
    low = butter(2, _SMOOTH_HZ, fs=true.fps, output="sos")
    return true.theta + sosfiltfilt(low, theta - true.theta, axis=0)


def _bony(body: BodyModelData, fitted: Motion, seen: NDArray) -> Motion:
    """As `--pose bony` reads it from a file."""
    with np.load(motion_path(str(fitted.source))) as stored:
        arrays: dict[str, Any] = dict(stored)
    z_up = Y_UP_FROM_Z_UP.inv().apply(seen.reshape(-1, 3)).reshape(seen.shape)
    labels = np.array(list(_all_markers(body)))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "take.npz"
        np.savez(path, **arrays | {"marker_data": z_up, "marker_labels": labels})
        read = load_motion(path)
        root_m = shaped_joints(body, read.betas[None])[0, 0]
        shift_m = read.about_root_joint(root_m).trans_m[0] - read.trans_m[0]
        theta = pack_theta(fitted.pose, fitted.trans_m - shift_m)
        return bone_pose_of(body, replace(read, theta=theta)).about_root_joint(root_m)


def _scores(
    trained: TrainedModel, true: Motion, offsets_m: NDArray, pose: Motion
) -> dict[str, float]:
    """R2 of offsets, of what is seen, and of the bust's alone."""
    found_m = _offsets(trained, pose)
    person = Smpl(trained.body).person(true.betas)
    moved, bare, drawn, alone = (
        faster(person.pose(*unpack_theta(one.theta), offsets)[..., 1], true.fps)
        for one, offsets in ((true, offsets_m), (true, None), (pose, found_m), (pose, None))
    )
    bust = [EMBEDDED_MARKERS["LBUST"], EMBEDDED_MARKERS["RBUSTLO"]]

    def r2(truth: NDArray, found: NDArray, none: NDArray | float = 0.0) -> float:
        return round(float(1 - ((found - truth) ** 2).sum() / ((none - truth) ** 2).sum()), 3)

    return {
        "r2_offsets": r2(offsets_m, found_m),
        "r2_bust_offsets": r2(offsets_m[:, bust], found_m[:, bust]),
        "r2_seen_up": r2(moved, drawn, bare),
        "r2_bust_seen_up": r2(moved[:, bust], drawn[:, bust], bare[:, bust]),
        "r2_bust_pose_alone": r2(moved[:, bust], alone[:, bust], bare[:, bust]),
    }


if __name__ == "__main__":
    run_as_process(MarkerPoseConfig, main)
