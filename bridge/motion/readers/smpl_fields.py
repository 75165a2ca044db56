"""Fields of SMPL, SMPL-H and SMPL-X motions: the names that people write, and what they hold."""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body.pickled_arrays import Record, as_array
from bridge.motion.motion import MOST_FRAMES
from bridge.runs.untrusted import text_of

WHOLE_KEYS = ("poses", "pose", "smpl_poses", "fullpose")
"""Hands and face stand in the same array."""
POSE_KEYS = (*WHOLE_KEYS, "bodyPose")
ROOT_KEYS = ("root_orient", "global_orient", "poses_root")
BODY_KEYS = ("pose_body", "body_pose", "poses_body")
TRANS_KEYS = ("trans", "transl", "smpl_trans", "bodyTranslation")
BETAS_KEYS = ("betas", "shapeParameters")
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
STATED_KINDS = {
    "smplVersion": {"0": "smpl", "1": "smplh", "2": "smplx"},
    "surface_model_type": {"smpl": "smpl", "smplh": "smplh", "smplx": "smplx"},
}
"""What smplcodec's files and AMASS's say of whose body they are."""
WANTED = (*POSE_KEYS, *PART_KEYS, *ROOT_KEYS, *BODY_KEYS, *TRANS_KEYS, *BETAS_KEYS, *RATE_KEYS,
          *STATED_KINDS, LENGTH_KEY, "gender", "dmpls", "smpl_scaling", "source", "body_model",
          "Rh")  # fmt: skip
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
    arrays = {}
    for name in WANTED:
        value = fields.get(name)
        if isinstance(value, (list, tuple)) and len(value) == 1:
            value = value[0]
        if isinstance(value, (str, bytes, int, float, np.ndarray)):
            arrays[name] = np.asarray(value)
        elif isinstance(value, Record) and value.kind != "unread":
            arrays[name] = as_array(value)
        elif strict and value is not None:
            raise ValueError(f"{name!r} is an object of another kind")
    return arrays


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
