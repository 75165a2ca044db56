"""SMPL parameters and skin offsets as an `.npz` with AMASS's keys and more, and as `.smpl`.

In the `.npz`, `poses` has the 52 joints of SMPL-H, as most of AMASS, or the 55 of SMPL-X, as its
Blender add-on needs; hands, jaw and eyes are the motion's. `poses` and `trans` have z up, as
readers of AMASS files expect. `theta` is the paper's pose vector of the same motion with y up, as
in all other exports. Offsets are in the rest pose, which does not depend on the up axis.
Meshcapade's `.smpl` cannot hold offsets that change.
"""

from __future__ import annotations

import json
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

from bridge.body.model_data import HAND_COUNT, Kind
from bridge.body.posing import full_pose, shaped_joints
from bridge.body.vertex_order import VERTICES, vertex_order
from bridge.motion.motion import amass_poses
from bridge.paper import N_JOINTS
from dsnet.exporters.output import export_facts
from dsnet.prediction.moving_body import MovingBody
from dsnet.prediction.shape_space import pelvis_apart_m

_TEXTS = ("data", "made_by", "predictor", "label", "model", "body_model", "motion")
SMPLH_JOINTS, SMPLX_JOINTS = 52, 55
_SMPL_GENDERS = {"neutral": 0, "male": 1, "female": 2}
_SMPL_VERSIONS = {SMPLH_JOINTS: 1, SMPLX_JOINTS: 2}
_CODEC_VERSION = 2


def write(path: Path, moving: MovingBody, joints: int | None = None) -> None:
    """Write `poses` (T, 3 * joints) and `trans` (T, 3), z up; `theta` (T, 69), y up; `offsets`
    (T, V, 3). `joints` are SMPL-X's if body or motion are SMPL-X, else SMPL-H's.

    Other keys are `betas` (10,), `gender`, `mocap_framerate`, `root_joint` (3,), the rest position
    about which the root turns, `vertices`, the digest of their order, and facts of the export as
    texts.
    """
    joints = joints or _joints(moving)
    shape = (len(moving), moving.body.vertex_count, 3)
    with zipfile.ZipFile(path, "w") as archive:
        for name, value in _parameters(moving, joints).items():
            with archive.open(f"{name}.npy", "w") as file:
                npy.write_array(file, np.asarray(value), allow_pickle=False)
        with archive.open("offsets.npy", "w", force_zip64=True) as file:
            header = {"descr": "<f4", "fortran_order": False, "shape": shape}
            npy.write_array_header_2_0(file, header)
            for posed in moving.shown("npz"):
                file.write(np.ascontiguousarray(posed.offsets_m, "<f4").tobytes())


def write_smplx(path: Path, moving: MovingBody) -> None:
    """The same with the joints of SMPL-X."""
    write(path, moving, SMPLX_JOINTS)


def write_smpl(path: Path, moving: MovingBody) -> None:
    """Write pose, translation and shape as the library smplcodec reads them: SMPL, y up.

    The format knows SMPL-H and SMPL-X alone. Another body, such as an embedded one, is replaced by
    the written kind's mean shape, with the pelvis at the same place.
    """
    motion, count = moving.motion, _joints(moving)
    kind: Kind = "smplx" if count == SMPLX_JOINTS else "smplh"
    written = replace(motion, kind=kind, embedded_betas=False)
    same_betas = (moving.body.kind == "smplx") == (kind == "smplx")
    same_betas &= moving.body.source != "synthetic"
    pose = full_pose(motion.pose, motion.hands_and_face, count)
    head, left, right = np.split(pose[:, N_JOINTS:], [-HAND_COUNT, -HAND_COUNT // 2], axis=1)
    gender = moving.body.gender if moving.body.gender in _SMPL_GENDERS else motion.gender
    arrays: dict[str, Any] = {
        "codecVersion": _CODEC_VERSION,
        "smplVersion": _SMPL_VERSIONS[count],
        "gender": _SMPL_GENDERS.get(gender, _SMPL_GENDERS["neutral"]),
        "shapeParameters": motion.betas if same_betas else np.zeros_like(motion.betas),
        "frameCount": len(pose),
        "frameRate": motion.fps,
        "bodyTranslation": motion.trans_m - pelvis_apart_m(written, moving.body),
        "bodyPose": pose[:, :N_JOINTS],
        "headPose": head,
        "leftHandPose": left,
        "rightHandPose": right,
    }
    if count == SMPLH_JOINTS:
        del arrays["headPose"]
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)


def _joints(moving: MovingBody) -> int:
    """How many joints to write: SMPL-X's if body or motion are SMPL-X, else SMPL-H's."""
    with_face = moving.body.kind == "smplx" or moving.motion.all_joints.shape[1] == SMPLX_JOINTS
    return SMPLX_JOINTS if with_face else SMPLH_JOINTS


def _parameters(moving: MovingBody, joints: int) -> dict[str, Any]:
    facts, motion = export_facts(moving), moving.motion
    root_joint_m = shaped_joints(moving.body, motion.betas[None])[0, 0]
    full = full_pose(motion.pose, motion.hands_and_face, joints)
    poses, trans_m = amass_poses(full, motion.trans_m, root_joint_m)
    return {
        "poses": poses,
        "trans": trans_m,
        "betas": motion.betas,
        "gender": facts["gender"],
        "surface_model_type": moving.body.kind,  # of the betas, whatever the number of joints
        "mocap_framerate": motion.fps,
        "up_axis": "z",
        "theta": motion.theta,
        "theta_up_axis": motion.up,
        "root_joint": root_joint_m,
        "length_unit": "m",
        "angle_unit": "rad",
        **{key: facts[key] for key in _TEXTS},
        VERTICES: vertex_order(moving.body),
        "controls": json.dumps(moving.controls),
    }
