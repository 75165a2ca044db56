"""Places of SMPL's joints, as HumanML3D (`new_joints`) and MDM (`results.npy`) have them: `.npy` of
(T, 22, 3), 20 frames a second, y up. Other `.npy` that hold motions are recognised by their arrays:
Motion-X's (T, 322) of SMPL-X, MDM's `*_smpl_params.npy` (`thetas` (24, 6, T)), and dictionaries of
SMPL's arrays.

Rotations are found by inverse kinematics in closed form.
Pelvis and chest are turned onto their three bones each, all others by the shortest turn from the
joint above. A thigh or an upper arm then turns about itself until its knee or elbow bends in the
plane in which the file's bends, the more so the more it is bent. How forearms, hands and the head
turn about themselves, places do not say.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.body.model_data import SMPL_PARENTS
from bridge.body.pickled_arrays import as_array
from bridge.body.safe_pickle import load_restricted_item
from bridge.errors import DsnetError
from bridge.motion.directions import shortest_turn, unit
from bridge.motion.motion import AS_IT_SAYS, MOST_FRAMES, HowRead, Motion
from bridge.motion.readers import pickles
from bridge.motion.readers.smpl_arrays import motion_of
from bridge.motion.readers.tracks import chosen_person
from bridge.motion.retargeting import (
    is_mirrored,
    local_rotations,
    mean_joints,
    smpl_places,
    standing_direction,
    upright_turn,
)
from bridge.motion.skeletons import OWN_NAMES
from bridge.motion.theta import pack_theta
from bridge.paper import N_BETAS, N_JOINTS
from bridge.runs.untrusted import NpyHeader, file_refused, open_regular, read_npy

_FPS = 20.0
_MOST_BYTES = 1 << 28
_MDM, _MDM_TURNS = "motion", "thetas"
_FEATURES = (263, 251)
"""Of HumanML3D and KIT, a frame."""
_MOTION_X_FPS, _MOTION_X_WIDTH = 30.0, 322
_MOTION_X = {
    "root_orient": slice(3),
    "pose_body": slice(3, 66),
    "pose_hand": slice(66, 156),
    "pose_jaw": slice(156, 159),
    "trans": slice(309, 312),
    "betas": slice(312, 322),
}
"""Columns of SMPL-X's arrays; between jaw and place are those of the face's shape."""
_LONGEST_M, _MOST_APART_CM = 1e6, 15.0
_CHILDREN = [
    [joint for joint in range(N_JOINTS) if SMPL_PARENTS[joint] == parent]
    for parent in range(N_JOINTS)
]
_HINGES = {1: (4, 7), 2: (5, 8), 16: (18, 20), 17: (19, 21)}
"""Of a thigh or an upper arm, the joint at its end and the one beyond."""
_HINGE_AXES = {1: (1.0, 0.0, 0.0), 2: (1.0, 0.0, 0.0), 16: (0.0, -1.0, 0.0), 17: (0.0, 1.0, 0.0)}
"""About which it bends, in the rest pose."""
_STRAIGHT, _BENT = 0.1, 0.35
"""Sines of the bend below which it is not used, and above which it alone is."""
_REMEDY = "Pass the places of SMPL's 22 joints, or poses as .npz."


def gender_of(path: Path) -> str | None:
    """No such file says; None of other arrays."""
    try:
        with open_regular(path, _MOST_BYTES) as file:
            shape = NpyHeader.read(file).shape
    except (OSError, ValueError):
        return None
    shapes = (N_JOINTS, 3), (24, 3), (_MOTION_X_WIDTH,)
    return "unknown" if shape[1:] in shapes else None


def is_smpl_family(path: Path) -> bool:
    """Whether it is Motion-X's: places of joints are nobody's vertices."""
    try:
        with open_regular(path, _MOST_BYTES) as file:
            return NpyHeader.read(file).shape[1:] == (_MOTION_X_WIDTH,)
    except (OSError, ValueError):
        return False


def read(path: Path, how: HowRead = AS_IT_SAYS) -> Motion:
    """Read and check one file; of several samples the first."""
    with file_refused(path, _refused, _REMEDY), open_regular(path, _MOST_BYTES) as file:
        has_objects = NpyHeader.read(file).dtype.hasobject
        file.seek(0)
        stored = load_restricted_item(file) if has_objects else read_npy(file)
        if isinstance(stored, dict) and _MDM not in stored:
            return pickles.read(path, how)
        if isinstance(stored, dict) and _MDM_TURNS in stored:
            turns, places = (as_array(stored[key]) for key in (_MDM_TURNS, "root_translation"))
            arrays = {"poses": turns.transpose(2, 0, 1), "trans": places.T}
            return motion_of(path, arrays, how, _FPS)
        joints, notes = (
            _of_samples(path, stored, how) if isinstance(stored, dict) else (as_array(stored), [])
        )
    if joints.ndim == 2 and joints.shape[1] == _MOTION_X_WIDTH:
        arrays = {name: joints[:, columns] for name, columns in _MOTION_X.items()}
        return motion_of(path, arrays, how, _MOTION_X_FPS)
    if not notes:
        chosen_person(path, how, [len(joints)], notes)
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
    notes.append(f"{path} says no rate: HumanML3D's {_FPS:g} a second, or what --motion-fps says")
    motion = motion_from_joints(path, joints, _FPS, how)
    return replace(motion, notes=(*notes, *motion.notes))


def _of_samples(path: Path, stored: dict[str, Any], how: HowRead) -> tuple[NDArray, list[str]]:
    """(T, 22, 3) of one of MDM's samples (N, 22, 3, T), which are filled up to the longest, and
    notes about it."""
    motions = as_array(stored[_MDM])
    if motions.ndim != 4 or not len(motions):
        raise ValueError(f"motions of shape {motions.shape}")
    lengths = as_array(stored["lengths"]).ravel() if "lengths" in stored else [motions.shape[3]]
    notes: list[str] = []
    chosen = chosen_person(path, replace(how, person=how.person or 1), [0] * len(motions), notes)
    if notes:
        which = f"sample {chosen + 1}" if chosen else "the first"
        notes = [f"{path} holds {len(motions)} samples: {which} is read, --person says another"]
    length = int(lengths[min(chosen, len(lengths) - 1)])
    return motions[chosen, :, :, : max(length, 0)].transpose(2, 0, 1), notes


def _refused(path: Path, flaw: str, remedy: str = _REMEDY) -> DsnetError:
    return DsnetError(
        f"{path}, {flaw}", "places of joints (T, 22, 3) as HumanML3D has them", remedy
    )


def motion_from_joints(path: Path, joints: NDArray[np.float64], fps: float, how: HowRead) -> Motion:
    """The motion of places (T, 22, 3) of SMPL's joints, in any unit, for a body of the mean shape.

    Its notes say how far the joints of that body are from the file's.
    """
    notes = []
    direction = standing_direction({name: joints[:, n] for n, name in enumerate(OWN_NAMES)})
    axis = "xyz"[int(np.abs(direction).argmax())]
    if how.up != "auto":
        axis = how.up
    elif axis != "y":
        notes.append(f"{path} is taken as {axis} up, for its bodies stand so: --up says otherwise")
    sign = 1 if how.up != "auto" or direction["xyz".index(axis)] > 0 else -1
    rest_m = mean_joints()
    joints = joints @ upright_turn(axis, sign).T
    if is_mirrored({name: joints[:, n] for n, name in enumerate(OWN_NAMES)}):
        notes.append(
            f"{path} has feet and knees that point backwards: its x axis is taken the other way "
            "round. If left and right are exchanged instead, exchange them"
        )
        joints = joints * [-1.0, 1.0, 1.0]
    joints *= _legs(rest_m[None]).item() / float(np.median(_legs(joints)))
    world = _turns(joints, rest_m)
    moved_m = smpl_places(world) + joints[:, :1]
    apart_cm = 100 * np.linalg.norm(moved_m - joints, axis=-1).mean(axis=0)
    if apart_cm.mean() > _MOST_APART_CM:
        flaw = f"whose joints are {apart_cm.mean():.0f} cm from a body's in the mean"
        raise _refused(path, flaw, "Pass the places of SMPL's joints in SMPL's order.")
    worst = int(apart_cm.argmax())
    most = f", {OWN_NAMES[worst]} {apart_cm[worst]:.1f} cm" if apart_cm[worst] >= 0.05 else ""
    notes.append(
        f"{path} has places of joints alone: rotations are found by inverse kinematics, and the "
        f"body's joints are {apart_cm.mean():.1f} cm from the file's in the mean{most}"
    )
    theta = pack_theta(local_rotations(world), joints[:, 0])
    return Motion(theta, np.zeros(N_BETAS), "unknown", fps, fps, path, up="y", trans_of="joint",
                  notes=tuple(notes))  # fmt: skip


def _legs(joints: NDArray) -> NDArray[np.float64]:
    """(T,) lengths of the left thigh and shin."""
    return np.linalg.norm(np.diff(joints[:, (1, 4, 7)], axis=1), axis=-1).sum(axis=1)


def _turns(joints: NDArray[np.float64], rest_m: NDArray) -> NDArray[np.float64]:
    """(T, 22, 3, 3) world rotations."""
    world = np.empty((len(joints), N_JOINTS, 3, 3))
    for joint, children in enumerate(_CHILDREN):
        above = world[:, SMPL_PARENTS[joint]]
        rest = rest_m[children] - rest_m[joint]
        bones = joints[:, children] - joints[:, joint, None]
        if len(children) == 3:
            world[:, joint] = _fitted(rest, bones)
        elif children:
            world[:, joint] = shortest_turn(above @ rest[0], bones[:, 0]) @ above
        else:
            world[:, joint] = above
        if joint in _HINGES:
            end, beyond = _HINGES[joint]
            axis = np.cross(unit(bones[:, 0]), unit(joints[:, beyond] - joints[:, end]))
            world[:, joint] = _twisted(world[:, joint], unit(bones[:, 0]), axis, _HINGE_AXES[joint])
    return world


def _fitted(rest: NDArray, bones: NDArray) -> NDArray[np.float64]:
    """(T, 3, 3) rotations that bring directions (3, 3) nearest to those of bones (T, 3, 3)."""
    left, _, right = np.linalg.svd(np.einsum("tix,iy->txy", unit(bones), unit(rest)))
    left[..., 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    return left @ right


def _twisted(
    world: NDArray, bone: NDArray, axis: NDArray, rest_axis: tuple[float, float, float]
) -> NDArray[np.float64]:
    """Turned about its bone (T, 3) until its hinge lies along the axis (T, 3) of the bend."""
    hinge = world @ np.array(rest_axis)
    hinge = unit(hinge - (hinge * bone).sum(axis=1, keepdims=True) * bone)
    sine = np.linalg.norm(axis, axis=1, keepdims=True)
    share = np.clip((sine - _STRAIGHT) / (_BENT - _STRAIGHT), 0, 1)
    towards = (1 - share) * hinge + share * axis / np.maximum(sine, 1e-12)
    cosine, across = (hinge * towards).sum(axis=1), np.cross(hinge, towards)
    angle = np.arctan2((across * bone).sum(axis=1), cosine)
    return Rotation.from_rotvec(bone * angle[:, None]).as_matrix() @ world
