"""Rotations of SMPL's, SMPL-H's and SMPL-X's joints from a motion's fields; whose body they turn.

All begin with the root's rotation and the 21 body joints: the 22 joints of the paper's pose vector.
Hands, jaw and eyes of SMPL-H and SMPL-X follow.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.motion.motion import LARGEST_ANGLE_RAD
from bridge.motion.readers.joint_rotations import axis_angles, by_joint, unusable
from bridge.motion.readers.smpl_fields import (
    BODY_KEYS,
    FACES,
    HANDS,
    JAW_KEY,
    POSE_KEYS,
    RELATIVE_KEYS,
    ROOT_KEYS,
    STATED_KINDS,
    Arrays,
    first_of,
    text_in,
)
from bridge.paper import N_JOINTS

_KINDS = {24: "smpl", 52: "smplh", 53: "smplx", 55: "smplx"}
"""By numbers of joints; of 53 nobody knows the order of the last 31."""
_MOVING = (52, 55)
_SMPLS_BODY = 23
"""Joints of SMPL without its root: only SMPL's end with two for the hands."""
_BODY_JOINTS = {N_JOINTS - 1, _SMPLS_BODY, *(count - 1 for count in (52, 53, 55))}


def pose_of(path: Path, arrays: Arrays) -> NDArray[np.float64]:
    """Joint rotations (T, 22, 3), axis-angle, that a body can take."""
    root, body = first_of(arrays, ROOT_KEYS), first_of(arrays, BODY_KEYS)
    whole = first_of(arrays, POSE_KEYS)
    if not whole and not (root and body):
        named = f"a {body!r} and no 'root_orient'" if body else "no 'poses'"
        raise unusable(path, f"which has {named}", "Pass a motion, not a shape or a model file.")
    keys = [key for key in ((whole,) if whole else (root, body)) if key]
    parts = {key: _by_joint(path, arrays, key)[:, :N_JOINTS] for key in keys}
    apart = {} if whole else {root: {1}, body: _BODY_JOINTS}
    for key, counts in apart.items():
        if key and (count := _by_joint(path, arrays, key).shape[1]) not in counts:
            remedy = "Store the root's rotation once, and those of the body's joints without it."
            raise unusable(path, f"whose {key!r} has {count} joints", remedy)
    pose = axis_angles(path, parts)
    if pose.shape[1] < N_JOINTS:
        raise unusable(path, f"with poses of {pose.shape[1]} joints", "22 or more are needed.")
    if not len(pose):
        raise unusable(path, "which has zero frames", "Pass a motion with at least one frame.")
    # The largest entry: squares of what a hostile file holds overflow.
    if (angle_rad := np.abs(pose).max()) > LARGEST_ANGLE_RAD:
        flaw = f"whose 'poses' turn a joint by {angle_rad:.3g} rad"
        raise unusable(path, flaw, f"Angles are radians, at most {LARGEST_ANGLE_RAD:g}.")
    # The root may have turned round and round; no limb does.
    if (usual_rad := np.median(np.abs(pose[:, 1:]).max(axis=(1, 2)))) > 2 * np.pi:
        flaw = f"whose 'poses' turn a limb by {usual_rad:.3g} rad over half of the time"
        raise unusable(path, flaw, "Convert them to radians: they seem to be degrees.")
    return pose


def _by_joint(path: Path, arrays: Arrays, key: str) -> NDArray:
    least = 1 if key in ROOT_KEYS else N_JOINTS - (key in BODY_KEYS)
    return by_joint(path, key, arrays[key], least)


def hands_and_face(
    path: Path, arrays: Arrays, frames: int, notes: list[str]
) -> tuple[str | None, NDArray[np.float64] | None]:
    """Whose body a pose is of by its shape, and (T, 30 or 33, 3) of its hands and face, where they
    move."""
    whole, body = first_of(arrays, POSE_KEYS), first_of(arrays, BODY_KEYS)
    joints = np.empty((0, N_JOINTS, 3)) if whole is None else _by_joint(path, arrays, whole)
    if joints.shape[1] > N_JOINTS:
        kind, others = _KINDS.get(joints.shape[1]), joints[:, N_JOINTS:]
        if joints.shape[1] not in _MOVING or joints.shape[2] == 6:
            return kind, None
    else:
        if relative := first_of(arrays, RELATIVE_KEYS):
            notes.append(f"{path} does not say what its {relative!r} is relative to: flat hands")
        face, hands = (next((parts for parts in layouts if parts.keys() & arrays.keys()), None)
                       for layouts in (FACES, HANDS))  # fmt: skip
        if not face and not hands:
            is_smpls = not whole and body and _by_joint(path, arrays, body).shape[1] == _SMPLS_BODY
            return "smplx" if JAW_KEY in arrays else "smpl" if is_smpls else None, None
        kind, parts = "smplx" if face else "smplh", (face or {}) | (hands or HANDS[0])
        each = [_part(path, arrays, key, (frames, width), notes) for key, width in parts.items()]
        others = np.concatenate(each, axis=1).reshape(frames, -1, 3)
    try:
        turns = axis_angles(path, {"hands": others})
        far_rad = np.abs(turns).max(initial=0.0)
    except DsnetError:
        turns, far_rad = None, np.inf
    if far_rad > LARGEST_ANGLE_RAD:
        notes.append(f"{path} has hands or a face that turn by {far_rad:.3g} rad: left at rest")
        return kind, None
    return kind, turns if far_rad else None


def _part(
    path: Path, arrays: Arrays, key: str, shape: tuple[int, int], notes: list[str]
) -> NDArray:
    """(T, width) of a hand or a part of the face; zero if absent or none such."""
    part = arrays.get(key, np.zeros(shape))
    if part.shape[:1] == shape[:1] and part.size == np.prod(shape) and part.dtype.kind in "iuf":
        return part.reshape(shape)
    notes.append(f"{path} has {key!r} of shape {part.shape}, not {shape}: left at rest")
    return np.zeros(shape)


def stated_kind(path: Path, arrays: Arrays, notes: list[str]) -> str | None:
    """Whose body a pose is of, where the file says it."""
    key = first_of(arrays, tuple(STATED_KINDS))
    if key is None:
        return None
    stated = text_in(arrays, key).lower()
    if stated not in STATED_KINDS[key]:
        notes.append(
            f"{path} is of an unknown kind of body ({key} {stated[:20]!r}): "
            "its betas may mean another shape"
        )
    return STATED_KINDS[key].get(stated)
