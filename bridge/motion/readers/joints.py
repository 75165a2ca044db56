"""Places of SMPL's joints, as HumanML3D (`new_joints`) and MDM (`results.npy`) have them: `.npy` of
(T, 22, 3), 20 frames a second, y up."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body.safe_pickle import as_array, load_restricted_item
from bridge.errors import DsnetError
from bridge.motion.from_joints import motion_from_joints
from bridge.motion.motion import AS_IT_SAYS, MOST_FRAMES, HowRead, Motion
from bridge.paper import N_JOINTS
from bridge.runs.untrusted import NpyHeader, file_refused, open_regular, read_npy

SUFFIXES = (".npy",)
_FPS = 20.0
_MOST_BYTES = 1 << 28
_FEATURES = (263, 251)
"""Of HumanML3D and KIT, a frame."""
_LONGEST_M = 1e6
_REMEDY = "Pass the places of SMPL's 22 joints, or poses as .npz."


def sniff(path: Path) -> bool:
    """By its name."""
    return path.suffix.lower() in SUFFIXES


def gender_of(path: Path) -> str | None:
    """No such file tells; None of other arrays."""
    try:
        with open_regular(path, _MOST_BYTES) as file:
            shape = NpyHeader.read(file).shape
    except (OSError, ValueError):
        return None
    return "unknown" if shape[1:] in ((N_JOINTS, 3), (24, 3)) else None


def read(path: Path, how: HowRead = AS_IT_SAYS) -> Motion:
    """Read and check one file; of several samples the first."""
    with file_refused(path, _refused, _REMEDY), open_regular(path, _MOST_BYTES) as file:
        if NpyHeader.read(file).dtype.hasobject:
            joints = _of_samples(load_restricted_item(file))
        else:
            file.seek(0)
            joints = read_npy(file)
    joints = joints[0] if joints.ndim == 4 and len(joints) == 1 else joints
    if joints.ndim == 2 and joints.shape[1] in _FEATURES:
        remedy = "Recover its joints first, as HumanML3D does by recover_from_ric."
        raise _refused(path, f"of {joints.shape[1]} features a frame, which are not read", remedy)
    if joints.ndim != 3 or joints.shape[1] not in (N_JOINTS, 24) or joints.shape[2] != 3:
        raise _refused(path, f"an array of shape {joints.shape}")
    if not 0 < len(joints) <= MOST_FRAMES:
        raise _refused(path, f"of {len(joints)} frames", f"1 to {MOST_FRAMES} are read.")
    if joints.dtype.kind not in "iuf" or not np.isfinite(joints).all():
        raise _refused(path, "whose numbers are not all finite")
    joints = joints[:, :N_JOINTS].astype(np.float64)
    bones = np.linalg.norm(joints[:, (4, 5, 7, 8)] - joints[:, (1, 2, 4, 5)], axis=-1)
    if not (np.abs(joints).max() < _LONGEST_M and bones.min() > 1e-6):
        raise _refused(path, "whose legs have no length, or which is too far off")
    return motion_from_joints(path, joints, _FPS, how)


def _of_samples(found: Any) -> NDArray:
    """(T, 22, 3) of the first of MDM's samples (N, 22, 3, T)."""
    motions = as_array(found["motion"])
    if motions.ndim != 4 or not len(motions):
        raise ValueError(f"motions of shape {motions.shape}")
    return motions[0].transpose(2, 0, 1)


def _refused(path: Path, flaw: str, remedy: str = _REMEDY) -> DsnetError:
    return DsnetError(
        f"{path}, {flaw}", "places of joints (T, 22, 3) as HumanML3D has them", remedy
    )
