"""Fields of SMPL, SMPL-H and SMPL-X motions: the names that people write, and what they hold."""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body.pickled_arrays import Record, as_array
from bridge.motion.motion import MOST_FRAMES
from bridge.runs.untrusted import text_of

WHOLE_KEYS = ("poses", "pose", "smpl_poses", "fullpose", "pose_aa", "local_rot_aa",
              "pose_est_fullposes")  # fmt: skip
"""Hands and face stand in the same array. The last is MoSh++'s older name, as `pose_est_trans` and
`shape_est_betas`."""
POSE_KEYS = (*WHOLE_KEYS, "bodyPose")
ROOT_KEYS = ("root_orient", "global_orient", "poses_root")
BODY_KEYS = ("pose_body", "body_pose", "poses_body")
TRANS_KEYS = ("trans", "transl", "smpl_trans", "bodyTranslation", "translation", "trans_orig",
              "root_trans", "pose_est_trans")  # fmt: skip
BETAS_KEYS = ("betas", "shapeParameters", "beta", "shape", "pred_shape", "shape_est_betas")
RATE_KEYS = ("mocap_framerate", "mocap_frame_rate", "fps", "framerate", "frame_rate", "frameRate")
FACES = {"pose_jaw": 3, "pose_eye": 6}, {"headPose": 9}
HANDS = (
    {"pose_hand": 90},
    {"leftHandPose": 45, "rightHandPose": 45},
    {"pose_lhand": 45, "pose_rhand": 45},
)
"""Numbers a frame of what stands beside root and body: AMASS's, smplcodec's and Inter-X's, in the
order of SMPL-X's joints."""
RELATIVE_KEYS, JAW_KEY = ("left_hand_pose", "right_hand_pose"), "jaw_pose"
PART_KEYS = (*(key for parts in (*FACES, *HANDS) for key in parts), *RELATIVE_KEYS, JAW_KEY)
"""These, and smplx's: hands, which may be relative to a mean or to components that only a model
file has, and a jaw, which says whose body it is."""
LENGTH_KEY = "mocap_time_length"
"""Seconds."""
NUMBER_KEYS = ("frame_ids", "frame_id", "frames", "frame", "frame_indices")
"""Which frame of a video each is."""
SEEN_KEYS = ("track_mask", "is_valid", "valid_mask")
"""Whether somebody was seen in a frame."""
FLOOR_KEY = "floor_plane"
"""Its normal, of any length and sign."""
OF_FIRST_CAMERA = ("cam_R", "world_scale", "intrins")
"""Who has one of these has a world whose axes are those of a video's first camera, as SLAHMR's."""
OF_CAMERA = {"smpl_params_incam": "GVHMR's", "smplx_cam": "PromptHMR's", "3d_joints": "PHALP's",
             "pred_rotmat": "TRAM's"}  # fmt: skip
"""Fields of poses in a camera's space, and whose."""
OF_WORLD = ("smpl_params_global", "smplx_world")
"""Dictionaries of poses in a world, which may stand beside those."""
NESTS = ("body", "arr_0")
"""Of an `.npz`: fields that may hold a dictionary, as GRAB's."""
STATED_KINDS = {
    "smplVersion": {"0": "smpl", "1": "smplh", "2": "smplx"},
    "surface_model_type": {"smpl": "smpl", "smplh": "smplh", "smplx": "smplx"},
}
"""What smplcodec's files and AMASS's say of whose body they are."""
BESIDE_KEYS = (*NUMBER_KEYS, *SEEN_KEYS, FLOOR_KEY, *OF_FIRST_CAMERA)
"""What may be of any other meaning in another file, where it is passed over."""
WANTED = (*POSE_KEYS, *PART_KEYS, *ROOT_KEYS, *BODY_KEYS, *TRANS_KEYS, *BETAS_KEYS, *RATE_KEYS,
          *STATED_KINDS, LENGTH_KEY, "gender", "dmpls", "smpl_scaling", "source", "body_model",
          "Rh", "Th", *BESIDE_KEYS)  # fmt: skip
MOST_BYTES = MOST_FRAMES * 8 * 9 * 55
"""Of an array: matrices of SMPL-X's joints."""
_GENDERS = {"f": "female", "m": "male", "n": "neutral", "0": "neutral", "1": "male", "2": "female"}

Arrays = Mapping[str, NDArray]


def arrays_of(fields: Mapping[str, Any], *, strict: bool = False) -> dict[str, NDArray]:
    """Those of `WANTED` among a file's fields: numbers, text, arrays and what
    `bridge.body.pickled_arrays.as_array` makes one of, each alone or in a list of one.

    `strict`: ValueError if one that is there is none of these; else it is passed over, as are
    things of other meanings under the names of pickles.
    """
    arrays, fields = {}, unprefixed(fields)
    for name in WANTED:
        value = fields.get(name)
        if isinstance(value, (list, tuple)) and len(value) == 1:
            value = value[0]
        if name in BESIDE_KEYS and isinstance(value, list):
            value = np.array(value) if all(type(one) in (int, bool) for one in value) else None
        if isinstance(value, (str, bytes, int, float, np.ndarray)):
            arrays[name] = np.asarray(value)
        elif isinstance(value, Record) and value.kind != "unread":
            arrays[name] = as_array(value)
        elif strict and value is not None and name not in BESIDE_KEYS:
            raise ValueError(f"{name!r} is an object of another kind")
    return arrays


def unprefixed(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Without the prefixes of Seamless Interaction's `smplh:body_pose`."""
    return {name.rpartition(":")[2]: value for name, value in fields.items()}


def holds_poses(names: Container[str]) -> bool:
    """Whether arrays of these names are a motion's."""
    return any(key in names for key in POSE_KEYS) or any(key in names for key in BODY_KEYS)


def first_of(arrays: Arrays, keys: tuple[str, ...]) -> str | None:
    """The first of these names that is there."""
    return next((key for key in keys if key in arrays), None)


def text_in(arrays: Arrays, key: str) -> str:
    """One text that is stored under a name; none, or several, are an empty one."""
    stored = arrays.get(key, np.array(""))
    return text_of(stored) if stored.size == 1 else ""


def gender_stored(arrays: Arrays) -> str:
    """As it is stored: text, bytes, their first letter, or a number as `.smpl` files have it."""
    return gender_in(text_in(arrays, "gender"))


def gender_in(stated: object) -> str:
    """What a file's word for a gender means."""
    word = stated.strip().lower() if isinstance(stated, str) else ""
    word = word.removeprefix("b'").removesuffix("'")
    word = _GENDERS.get(word, word)
    return word if word in _GENDERS.values() else "unknown"
