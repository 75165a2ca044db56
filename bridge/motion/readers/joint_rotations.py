"""Rotations of joints as arrays, in the layouts that people write: axis-angle, matrices, two of
their lines or columns; flat or by joint. What is refused is told in the same words of all.
"""

from __future__ import annotations

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
_LEAST_KNEE_RAD = 0.02


def unusable(path: Path, flaw: str, remedy: str = "Download the file again.") -> DsnetError:
    """The line that says why a file is refused."""
    return DsnetError(
        f"{path}, {flaw}", "poses of SMPL's family, as an AMASS motion file has them", remedy
    )


def finite(
    path: Path, name: str, array: NDArray, frame_count: int | None = None
) -> NDArray[np.float64]:
    """An array of a file, which has a row of numbers for each of so many frames if these are said;
    `DsnetError` if not, or if it holds anything but finite numbers."""
    if array.dtype.kind not in "iuf" or not np.isfinite(array).all():
        raise unusable(path, f"whose {name!r} are not all finite numbers")
    if frame_count is not None and (array.ndim != 2 or len(array) != frame_count or not array.size):
        raise unusable(
            path, f"whose {name!r} have shape {array.shape} beside {frame_count} frames of poses"
        )
    return array.astype(np.float64)


def axis_angles(path: Path, name: str, joints: NDArray) -> NDArray[np.float64]:
    """(T, J, 3) of what `by_joint` gives."""
    chosen = finite(path, name, joints)
    return chosen if chosen.shape[2:] == (3,) else _of_matrices(path, chosen)


def by_joint(path: Path, name: str, array: NDArray, *, part: bool) -> NDArray:
    """An array of any layout as (T, J, 3), (T, J, 6) or (T, J, 3, 3); of a `part`, root or body
    alone, there are fewer joints."""
    if array.dtype.kind not in "iuf":
        raise unusable(path, f"whose {name!r} are not all finite numbers")
    if array.ndim and array.shape[0] > MOST_FRAMES:
        raise DsnetError(
            f"{path}, a motion of {array.shape[0]} frames",
            f"at most {MOST_FRAMES}",
            "Cut it into several files.",
        )
    match array.shape:
        case (count, width) if width in {3, *BODY_WIDTHS} if part else width in WIDTHS:
            return array.reshape(count, width // 3, 3)
        case (_, joints, 3) if joints >= (1 if part else N_JOINTS):
            return array
        case (_, _, 3, 3) | (_, _, 6):
            return array
        case (count, width) if width in _SIX and not part:
            return array.reshape(count, width // 6, 6)
        case shape:
            known = ", ".join(f"{width} ({model})" for width, model in WIDTHS.items())
            raise DsnetError(
                f"{path}, whose {name!r} have shape {shape}",
                f"(frames, width) with a width of {known}, or (frames, joints, 3)",
                "Pass poses of SMPL, SMPL-H or SMPL-X.",
            )


def _of_matrices(path: Path, given: NDArray[np.float64]) -> NDArray[np.float64]:
    """(T, J, 3) of matrices (T, J, 3, 3), or of two of their lines or columns (T, J, 6).

    Which of the two, no file says: knees bend one way.
    """
    frames, joints = given.shape[:2]
    lines = given.reshape(frames * joints, -1)
    is_six = lines.shape[1] == 6
    if is_six:
        first, second = lines[:, :3], lines[:, 3:]
        lines = np.stack([first, second, np.cross(first, second)], axis=2)
    matrices = lines.reshape(-1, 3, 3)
    far = np.abs(matrices @ np.swapaxes(matrices, 1, 2) - np.eye(3)).max(initial=0)
    if not far < 1e-2 or (np.linalg.det(matrices) < 0).any():
        raise unusable(path, "whose poses are no rotations", "Store axis-angle rotations.")
    pose = Rotation.from_matrix(matrices).as_rotvec().reshape(frames, joints, 3)
    if joints < N_JOINTS or not is_six:
        return pose
    knees_rad = float(pose[:, (4, 5), 0].mean()) if frames else 0.0
    if abs(knees_rad) < _LEAST_KNEE_RAD:
        flaw = "of six numbers a joint, whose knees do not tell whether these are lines or columns"
        raise unusable(path, flaw, "Store axis-angle rotations.")
    return pose if knees_rad > 0 else -pose
