"""Rotations of joints as arrays, in the layouts that people write: axis-angle, matrices, two of
their lines or columns; flat or by joint. All refuse in the same words.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.errors import DsnetError
from bridge.motion.motion import MOST_FRAMES
from bridge.paper import N_JOINTS

WIDTHS = {66: "SMPL's 22 joints", 72: "SMPL", 156: "SMPL-H", 159: "SMPL-X without its jaw or eyes",
           165: "SMPL-X"}  # fmt: skip
BODY_WIDTHS = {63, 69}
"""Without the root."""
_SIX = {132, 144}
"""Of 22 or 24 joints, the first two lines or columns of each matrix."""
_KNEES, _LEAST_KNEE_RAD = [4, 5], 0.02


def unusable(path: Path, flaw: str, remedy: str = "Download the file again.") -> DsnetError:
    """The line that says why a file is refused."""
    return DsnetError(
        f"{path}, {flaw}", "poses of SMPL's family, as an AMASS motion file has them", remedy
    )


def finite(
    path: Path, name: str, array: NDArray, frame_count: int | None = None
) -> NDArray[np.float64]:
    """An array of a file, which has a row of numbers for each of so many frames if these are given;
    `DsnetError` if not, or if it holds anything but finite numbers."""
    if array.dtype.kind not in "iuf" or not np.isfinite(array).all():
        raise unusable(path, f"whose {name!r} are not all finite numbers")
    if frame_count is not None and (array.ndim != 2 or len(array) != frame_count or not array.size):
        raise unusable(
            path, f"whose {name!r} have shape {array.shape} beside {frame_count} frames of poses"
        )
    return array.astype(np.float64)


def axis_angles(path: Path, parts: Mapping[str, NDArray]) -> NDArray[np.float64]:
    """(T, J, 3) of what `by_joint` gives of several arrays, one after another.

    Whether six numbers are lines or columns, no file says: knees bend one way.
    """
    counts = {name: len(part) for name, part in parts.items()}
    if len({*counts.values()}) > 1:
        raise unusable(path, f"whose arrays have different numbers of frames ({counts})")
    turns = [_turns(path, finite(path, name, part)) for name, part in parts.items()]
    pose = np.concatenate(turns, axis=1)
    is_six = np.array([part.shape[2:] == (6,) for part in parts.values()])
    is_six = np.repeat(is_six, [part.shape[1] for part in parts.values()])
    if not is_six.any():
        return pose
    has_knees = pose.shape[1] > _KNEES[-1] and is_six[_KNEES].all() and len(pose)
    knees_rad = float(pose[:, _KNEES, 0].mean()) if has_knees else 0.0
    if abs(knees_rad) < _LEAST_KNEE_RAD:
        flaw = "of six numbers a joint, whose knees do not show whether these are lines or columns"
        raise unusable(path, flaw, "Store axis-angle rotations.")
    return np.where(is_six[:, None] & (knees_rad < 0), -pose, pose)


def by_joint(path: Path, name: str, array: NDArray, least: int = N_JOINTS) -> NDArray:
    """An array of any layout as (T, J, 3), (T, J, 6) or (T, J, 3, 3), of so many joints at least:
    the root's alone, the body's without it, or all."""
    if array.dtype.kind not in "iuf":
        raise unusable(path, f"whose {name!r} are not all finite numbers")
    if array.ndim and array.shape[0] > MOST_FRAMES:
        raise DsnetError(
            f"{path}, a motion of {array.shape[0]} frames",
            f"at most {MOST_FRAMES}",
            "Cut it into several files.",
        )
    match array.shape:
        case (count, width) if width in {1: {3}, N_JOINTS: WIDTHS}.get(least, BODY_WIDTHS):
            return array.reshape(count, width // 3, 3)
        case (_, 3, 3) if least == 1:
            return array[:, None]
        case (_, joints, 3) if joints >= least:
            return array
        case (_, _, 3, 3) | (_, _, 6):
            return array
        case (count, width) if width in _SIX and least == N_JOINTS:
            return array.reshape(count, width // 6, 6)
        case shape:
            widths = ", ".join(f"{width} ({model})" for width, model in WIDTHS.items())
            raise DsnetError(
                f"{path}, whose {name!r} have shape {shape}",
                f"(frames, width) with a width of {widths}, or (frames, joints, 3)",
                "Pass poses of SMPL, SMPL-H or SMPL-X.",
            )


def _turns(path: Path, given: NDArray[np.float64]) -> NDArray[np.float64]:
    """(T, J, 3) of these, of matrices (T, J, 3, 3), or of two of their columns (T, J, 6)."""
    if given.shape[2:] == (3,):
        return given
    frames, joints = given.shape[:2]
    matrices = given.reshape(frames * joints, -1)
    if matrices.shape[1] == 6:
        first, second = matrices[:, :3], matrices[:, 3:]
        matrices = np.stack([first, second, np.cross(first, second)], axis=2)
    matrices = matrices.reshape(-1, 3, 3)
    far = np.abs(matrices @ np.swapaxes(matrices, 1, 2) - np.eye(3)).max(initial=0)
    if not far < 1e-2 or (np.linalg.det(matrices) < 0).any():
        raise unusable(path, "whose poses are no rotations", "Store axis-angle rotations.")
    return Rotation.from_matrix(matrices).as_rotvec().reshape(frames, joints, 3)
