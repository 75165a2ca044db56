"""Poses of SMPL, SMPL-H and SMPL-X as arrays, under the names and in the layouts that people write.

All begin with the root's rotation and the 21 body joints: the 22 joints of the paper's pose vector.
Hands, jaw and eyes of SMPL-H and SMPL-X follow. A file does not say which axis is its vertical, so
the bodies tell: they stand along z as in AMASS, or along y as video models and generators write.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body.embedded import EMBEDDED_PREFIX
from bridge.body.pickled_arrays import Record, as_array
from bridge.errors import DsnetError
from bridge.motion.motion import (
    FARTHEST_M,
    HIGHEST_M,
    LARGEST_ANGLE_RAD,
    LARGEST_BETA,
    MOST_FRAMES,
    RATES_HZ,
    HowRead,
    Motion,
    UpAxis,
    pack_theta,
)
from bridge.motion.readers.joint_rotations import (
    BODY_WIDTHS,
    WIDTHS,
    axis_angles,
    by_joint,
    finite,
    unusable,
)
from bridge.motion.retargeting import (
    smpl_places,
    some_frames,
    standing_direction,
    world_rotations,
)
from bridge.motion.skeletons import OWN_NAMES
from bridge.paper import N_BETAS, N_JOINTS
from bridge.runs.untrusted import text_of

WHOLE_KEYS = ("poses", "pose", "smpl_poses", "fullpose")
"""Hands and face stand in the same array."""
POSE_KEYS = (*WHOLE_KEYS, "bodyPose")
ROOT_KEYS = ("root_orient", "global_orient", "poses_root")
BODY_KEYS = ("pose_body", "body_pose", "poses_body")
TRANS_KEYS = ("trans", "transl", "smpl_trans", "bodyTranslation")
BETAS_KEYS = ("betas", "shapeParameters")
RATE_KEYS = ("mocap_framerate", "mocap_frame_rate", "fps", "framerate", "frame_rate", "frameRate")
_FACES = {"pose_jaw": 3, "pose_eye": 6}, {"headPose": 9}
_HANDS = (
    {"pose_hand": 90},
    {"leftHandPose": 45, "rightHandPose": 45},
    {"pose_lhand": 45, "pose_rhand": 45},
)
"""Numbers a frame of what stands beside root and body: AMASS's, smplcodec's and Inter-X's, in the
order of SMPL-X's joints."""
_RELATIVE, _JAW = ("left_hand_pose", "right_hand_pose"), "jaw_pose"
PART_KEYS = (*(key for parts in (*_FACES, *_HANDS) for key in parts), *_RELATIVE, _JAW)
"""These, and smplx's: hands, which may be relative to a mean or to components that only a model
file has, and a jaw, which tells whose body it is."""
_LENGTH = "mocap_time_length"
"""Seconds."""
_SAID_KINDS = {
    "smplVersion": {"0": "smpl", "1": "smplh", "2": "smplx"},
    "surface_model_type": {"smpl": "smpl", "smplh": "smplh", "smplx": "smplx"},
}
"""What smplcodec's files and AMASS's say of whose body they are."""
WANTED = (*POSE_KEYS, *PART_KEYS, *ROOT_KEYS, *BODY_KEYS, *TRANS_KEYS, *BETAS_KEYS, *RATE_KEYS,
          *_SAID_KINDS, _LENGTH, "gender", "dmpls", "smpl_scaling", "source", "body_model",
          "Rh")  # fmt: skip
MOST_BYTES = MOST_FRAMES * 8 * 9 * 55
"""Of an array: matrices of SMPL-X's joints."""
_KINDS = {24: "smpl", 52: "smplh", 53: "smplx", 55: "smplx"}
"""By numbers of joints; of 53 nobody knows the order of the last 31."""
_MOVING = (52, 55)
_SMPLS_BODY = 23
"""Joints of SMPL without its root: only SMPL's end with two for the hands."""
_BODY_JOINTS = {N_JOINTS - 1, _SMPLS_BODY, *(count - 1 for count in (52, 53, 55))}
_GENDERS = {"f": "female", "m": "male", "n": "neutral", "0": "neutral", "1": "male", "2": "female"}
_UNITS = {"millimetres": 1000.0, "centimetres": 100.0}
_STANDING, _ASLANT = 0.7, 0.5
"""Least share of an axis in the mean direction of trunk and legs that stand along it, and the
largest of the other one beside it."""
_LYING = 0.3
"""Largest share of z in the direction of a trunk that is upright along y, as of who sits."""
_SAME_BETAS, _SAME_RATE, _SAME_LENGTH = 0.05, 0.01, 0.05

Arrays = Mapping[str, NDArray]


def motion_of(path: Path, arrays: Arrays, how: HowRead, usual_fps: float = np.nan) -> Motion:
    """A motion from arrays by name; `DsnetError` if they are none of a person.

    Parameters
    ----------
    usual_fps : the rate of files of this kind that do not say theirs.
    """
    if "Rh" in arrays:
        flaw = "whose bodies turn about the origin by 'Rh', as EasyMocap's"
        raise unusable(path, flaw, "Write them as 'root_orient' and 'trans' of SMPL.")
    notes: list[str] = []
    arrays = _of_first_person(path, arrays, notes)
    pose = _pose(path, arrays)
    kind, others = _others(path, arrays, len(pose), notes)
    kind = _said_kind(path, arrays, notes) or kind
    is_codecs = _first(arrays, POSE_KEYS) == "bodyPose"
    up = _vertical(path, pose, how, is_codecs, notes)
    trans_m = _trans(path, arrays, len(pose), up, notes)
    betas, fps = _betas(path, arrays, notes), _rate(path, arrays, usual_fps)
    length = arrays.get(_LENGTH, np.array(np.nan))
    said_s = float(length.item()) if length.size == 1 and length.dtype.kind in "iuf" else np.nan
    if abs(len(pose) / fps - said_s) > _SAME_LENGTH * said_s + 1 / fps:  # nan is not
        notes.append(
            f"{path} says that it lasts {said_s:.4g} s, but {len(pose)} frames at {fps:g} a second "
            f"last {len(pose) / fps:.4g}: --motion-fps says another rate"
        )
    return Motion(
        theta=pack_theta(pose, trans_m),
        betas=np.pad(betas, (0, max(N_BETAS - len(betas), 0)))[:N_BETAS],
        more_betas=betas[N_BETAS:],
        kind=kind,
        hands_and_face=others,
        gender=gender_stored(arrays),
        fps=fps,
        source_fps=fps,
        source=path,
        up=up,
        dmpls=finite(path, "dmpls", arrays["dmpls"], len(pose)) if "dmpls" in arrays else None,
        trans_of=up,
        embedded_betas=_said(arrays, "source").startswith("synthetic")
        or _said(arrays, "body_model").startswith(EMBEDDED_PREFIX),
        notes=tuple(notes),
    )


def _of_first_person(path: Path, arrays: Arrays, notes: list[str]) -> Arrays:
    """Where an axis of people, or of a batch, stands before that of frames."""
    key = _first(arrays, (*POSE_KEYS, *BODY_KEYS))
    shape = arrays[key].shape if key else ()
    if len(shape) != 3 or shape[2] not in WIDTHS.keys() | BODY_WIDTHS or not shape[0]:
        return arrays
    if shape[0] > 1 == shape[1]:
        flaw = f"whose {key!r} have shape {shape}: whether of frames or of people, it does not say"
        raise unusable(path, flaw, "Stack the frames of one person.")
    if (people := shape[0]) > 1:
        notes.append(f"{path} holds {people} people: the first is read")
    keys = (*POSE_KEYS, *ROOT_KEYS, *BODY_KEYS, *PART_KEYS, *TRANS_KEYS, *BETAS_KEYS)
    each = {k: v for k, v in arrays.items() if k in keys and v.ndim > 1 and len(v) == people}
    return {**arrays, **{name: array[0] for name, array in each.items()}}


def arrays_of(fields: Mapping[str, Any], *, strict: bool = False) -> dict[str, NDArray]:
    """Those of `WANTED` among a file's fields: numbers, text, arrays and what
    `bridge.body.pickled_arrays.as_array` makes one of, each alone or in a list of one.

    `strict`: ValueError if one that is there is none of these; else it is passed over, as are
    things of other meanings under the names of pickles.
    """
    found = {}
    for name in WANTED:
        value = fields.get(name)
        if isinstance(value, (list, tuple)) and len(value) == 1:
            value = value[0]
        if isinstance(value, (str, bytes, int, float, np.ndarray)):
            found[name] = np.asarray(value)
        elif isinstance(value, Record) and value.kind != "unread":
            found[name] = as_array(value)
        elif strict and value is not None:
            raise ValueError(f"{name!r} is an object of another kind")
    return found


def holds_poses(names: Container[str]) -> bool:
    """Whether arrays of these names are a motion's."""
    return any(key in names for key in POSE_KEYS) or any(key in names for key in BODY_KEYS)


def _first(arrays: Arrays, keys: tuple[str, ...]) -> str | None:
    return next((key for key in keys if key in arrays), None)


def _pose(path: Path, arrays: Arrays) -> NDArray[np.float64]:
    """Joint rotations (T, 22, 3), axis-angle, that a body can take."""
    root, body = _first(arrays, ROOT_KEYS), _first(arrays, BODY_KEYS)
    whole = _first(arrays, POSE_KEYS)
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


def _others(
    path: Path, arrays: Arrays, frames: int, notes: list[str]
) -> tuple[str | None, NDArray[np.float64] | None]:
    """Whose body a pose is of by its shape, and (T, 30 or 33, 3) of its hands and face, where they
    move."""
    whole, body = _first(arrays, POSE_KEYS), _first(arrays, BODY_KEYS)
    joints = np.empty((0, N_JOINTS, 3)) if whole is None else _by_joint(path, arrays, whole)
    if joints.shape[1] > N_JOINTS:
        kind, others = _KINDS.get(joints.shape[1]), joints[:, N_JOINTS:]
        if joints.shape[1] not in _MOVING or joints.shape[2] == 6:
            return kind, None
    else:
        if relative := _first(arrays, _RELATIVE):
            notes.append(f"{path} does not say what its {relative!r} is relative to: flat hands")
        face, hands = (next((parts for parts in layouts if parts.keys() & arrays.keys()), None)
                       for layouts in (_FACES, _HANDS))  # fmt: skip
        if not face and not hands:
            is_smpls = not whole and body and _by_joint(path, arrays, body).shape[1] == _SMPLS_BODY
            return "smplx" if _JAW in arrays else "smpl" if is_smpls else None, None
        kind, parts = "smplx" if face else "smplh", (face or {}) | (hands or _HANDS[0])
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


def _said_kind(path: Path, arrays: Arrays, notes: list[str]) -> str | None:
    """Whose body a pose is of, where the file says it."""
    key = _first(arrays, tuple(_SAID_KINDS))
    if key is None:
        return None
    said = _said(arrays, key).lower()
    if said not in _SAID_KINDS[key]:
        notes.append(
            f"{path} is of a kind of body that is not known ({key} {said[:20]!r}): "
            "its betas may mean another shape"
        )
    return _SAID_KINDS[key].get(said)


def _vertical(
    path: Path, pose: NDArray[np.float64], how: HowRead, is_codecs: bool, notes: list[str]
) -> UpAxis:
    """The axis along which the bodies stand, or their trunks y; if they stand along none, z as in
    AMASS, but of smplcodec's files y."""
    if how.up != "auto":
        return how.up
    world = world_rotations(pose[some_frames(len(pose))])
    places = smpl_places(world).swapaxes(0, 1)
    _, y, z = standing_direction(dict(zip(OWN_NAMES, places, strict=True)))
    _, trunk_y, trunk_z = np.median(world[:, 0, :, 1], axis=0)
    stands = abs(y) >= _STANDING and abs(z) <= _ASLANT * abs(y)
    sits = trunk_y > _STANDING and abs(trunk_z) < _LYING
    if not stands and not sits:
        if not is_codecs:
            return "z"
        if z < _STANDING or abs(y) > _ASLANT * z:
            return "y"
        notes.append(f"{path} is taken as z up, for its bodies stand so: --up says otherwise")
        return "z"
    if stands and y < 0:
        raise unusable(
            path,
            "whose bodies stand head down along y, as in the space of a camera",
            "Export the motion in the world's space, or say its vertical by --up.",
        )
    notes.append(f"{path} is taken as y up, for its bodies stand so: --up says otherwise")
    return "y"


def _trans(
    path: Path, arrays: Arrays, frames: int, up: UpAxis, notes: list[str]
) -> NDArray[np.float64]:
    key = _first(arrays, TRANS_KEYS)
    if key is None:
        notes.append(
            f"{path} says nowhere where the body is: it moves on the spot, --floor lifts it"
        )
        return np.zeros((frames, 3))
    trans_m = finite(path, key, arrays[key], frames)
    if trans_m.shape[1] != 3:
        raise unusable(path, f"whose {key!r} have shape {trans_m.shape}")
    if (scaling := arrays.get("smpl_scaling")) is not None:  # AIST++'s bodies are in centimetres
        per_m = finite(path, "smpl_scaling", scaling)
        if per_m.size != 1 or not 0.01 < per_m.item() < 1e4:
            raise unusable(path, f"whose 'smpl_scaling' is {per_m.tolist()}"[:200])
        trans_m = trans_m / per_m.item()
    far_m, height_m = np.abs(trans_m).max(), abs(float(np.median(trans_m[:, "xyz".index(up)])))
    if far_m > FARTHEST_M or height_m > HIGHEST_M:
        # The unit in which a body's root is as high above the floor as hips are.
        likely = [unit for unit, per_m in _UNITS.items() if 0.2 < height_m / per_m < 2.0]
        remedy = f"it seems to be in {likely[0]}" if likely else "convert it"
        raise unusable(
            path,
            f"whose {key!r} are {far_m:.3g} m off, {height_m:.3g} m high over half of the time",
            f"Expected are metres, {up} up, at most {FARTHEST_M:g} off and {HIGHEST_M:g} high: "
            f"{remedy}.",
        )
    return trans_m


def _rate(path: Path, arrays: Arrays, usual_fps: float) -> float:
    """Frames a second; nan where the file does not say, or says two rates."""
    said = {key: _one_rate(path, key, arrays[key]) for key in RATE_KEYS if key in arrays}
    if not said:
        return usual_fps
    first, *others = said.values()
    return first if all(abs(rate / first - 1) < _SAME_RATE for rate in others) else np.nan


def _one_rate(path: Path, key: str, rate: NDArray) -> float:
    if rate.dtype.kind in "US" and rate.size == 1:
        try:
            rate = np.array(float(text_of(rate)))
        except ValueError:
            rate = np.array(np.nan)
    rate = finite(path, key, rate)
    if rate.size != 1 or not RATES_HZ[0] <= rate.item() <= RATES_HZ[1]:
        raise unusable(path, f"whose {key} is {rate.tolist()}"[:200], "Write its rate, Hz.")
    return rate.item()


def _betas(path: Path, arrays: Arrays, notes: list[str]) -> NDArray[np.float64]:
    """(k,) coefficients, of frames that have their own the median."""
    key = _first(arrays, BETAS_KEYS)
    if key is None:
        notes.append(f"{path} has no betas: the mean shape is taken")
        return np.zeros(N_BETAS)
    betas = finite(path, key, arrays[key])
    if betas.ndim == 2 and betas.shape[1] == 1:
        betas = betas[:, 0]
    if betas.ndim not in (1, 2) or not betas.size:
        flaw = f"whose {key!r} have shape {betas.shape}"
        raise unusable(path, flaw, f"Store one vector of {N_BETAS} or more coefficients.")
    betas = np.atleast_2d(betas)
    if (largest := np.abs(betas).max()) > LARGEST_BETA:
        raise unusable(path, f"whose {key!r} reach {largest:.3g}", "Store a person's, within 5.")
    if (far := np.ptp(betas[:, :N_BETAS], axis=0).max()) > _SAME_BETAS:
        notes.append(f"{path} changes its shape by up to {far:.2g} betas: the median is taken")
    return np.median(betas, axis=0)


def _said(arrays: Arrays, key: str) -> str:
    stored = arrays.get(key, np.array(""))
    return text_of(stored) if stored.size == 1 else ""


def gender_stored(arrays: Arrays) -> str:
    """As it is stored: text, bytes, their first letter, or a number as `.smpl` files have it."""
    return gender_in(_said(arrays, "gender"))


def gender_in(stated: object) -> str:
    """What a file's word for a gender means."""
    word = stated.strip().lower() if isinstance(stated, str) else ""
    word = word.removeprefix("b'").removesuffix("'")
    word = _GENDERS.get(word, word)
    return word if word in _GENDERS.values() else "unknown"
