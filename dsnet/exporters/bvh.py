"""BVH: SMPL's skeleton and its motion, without skin, for tools that move their own characters."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.body import BodyModelData
from bridge.body.posing import joint_rotations, shaped_joints
from dsnet.prediction.moving_body import MovingBody

_END_SITE = 0.5
"""Length of a last bone relative to its parent's: no joint says where it ends."""
_ROTATIONS = "Zrotation Xrotation Yrotation"


def write(path: Path, moving: MovingBody) -> None:
    """Write one file: metres, y up, degrees; joints have SMPL's names, the rest pose is its T."""
    body, motion = moving.body, moving.motion
    joints_m = shaped_joints(body, motion.betas[None])[0]
    rotations = joint_rotations(body, moving.pose)
    order = [*_depth_first(body, 0)]
    rows = [motion.trans_m + joints_m[0], *(_degrees(rotations[:, joint]) for joint in order)]
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.write("HIERARCHY\n" + "\n".join(_hierarchy(body, joints_m, 0)) + "\nMOTION\n")
        file.write(f"Frames: {len(moving)}\nFrame Time: {1 / motion.fps:.9f}\n")
        np.savetxt(file, np.concatenate(rows, axis=1), "%.6f")


def _children(body: BodyModelData, joint: int) -> list[int]:
    return np.flatnonzero(body.parents == joint).tolist()


def _depth_first(body: BodyModelData, joint: int) -> Iterator[int]:
    yield joint
    for child in _children(body, joint):
        yield from _depth_first(body, child)


def _hierarchy(body: BodyModelData, joints_m: NDArray, joint: int) -> Iterator[str]:
    """Lines of a joint and its descendants."""
    parent = body.parents[joint]
    # The root's offset is zero, as some readers add it to the channels and others do not.
    bone_m = joints_m[joint] - joints_m[max(parent, 0)]
    kind, channels = ("JOINT", f"3 {_ROTATIONS}") if parent >= 0 else (
        "ROOT", f"6 Xposition Yposition Zposition {_ROTATIONS}"
    )  # fmt: skip
    yield f"{kind} {body.joint_names[joint]}"
    yield "{"
    yield f"OFFSET {_numbers(bone_m)}"
    yield f"CHANNELS {channels}"
    children = _children(body, joint)
    for child in children:
        yield from _hierarchy(body, joints_m, child)
    if not children:
        yield from ("End Site", "{", f"OFFSET {_numbers(_END_SITE * bone_m)}", "}")
    yield "}"


def _numbers(values: NDArray) -> str:
    return " ".join(f"{value:.6f}" for value in values)


def _degrees(rotations: NDArray) -> NDArray[np.float64]:
    """Euler angles (T, 3) about z, x and y, without jumps of a whole turn."""
    with warnings.catch_warnings():
        # Where two axes coincide, any of the solutions is right.
        warnings.filterwarnings("ignore", "Gimbal lock", UserWarning)
        angles = Rotation.from_matrix(rotations).as_euler("ZXY", degrees=True)
    return np.unwrap(angles, axis=0, period=360)
