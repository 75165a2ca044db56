"""Pickles, torch files and dictionaries in `.npy`: of MoSh++, of generators, of models that see
people in videos, of datasets.

MoSh++'s `*_stageii.pkl` (AMASS's `poses` are its `fullpose`, or `pose_est_fullposes` in the older
layout, as SAMP's; its rate is that of the recording, of which it may have fitted every other frame,
`ds_rate`), AIST++ (`smpl_poses`, `smpl_trans`, `smpl_scaling`, 60 frames a second), 3DPW (a list of
people's in place of each array, 30 frames a second), EMDB (under `smpl`), WHAM (people by number;
plain or by joblib, compressed or not), GVHMR (`smpl_params_global`), PromptHMR (`people`,
`smplx_world`), PHC (motions by name), GRAB (`.npz` with `body`), and any other dictionary of SMPL's
arrays, however deep it lies. What they hold is read by `bridge.body.safe_pickle`, which runs
nothing, and without PyTorch. Poses in the space of a camera alone are refused: nobody knows there
where the floor is.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body.containers import load_torch
from bridge.body.pickled_arrays import as_array, plain_text
from bridge.body.safe_pickle import load_restricted, load_restricted_item
from bridge.errors import DsnetError
from bridge.motion.markers import MarkerFile
from bridge.motion.motion import AS_IT_SAYS, HowRead, Motion
from bridge.motion.readers.joint_rotations import unusable
from bridge.motion.readers.markers import OLDER, from_mosh, within
from bridge.motion.readers.smpl_arrays import motion_of
from bridge.motion.readers.smpl_fields import (
    BODY_KEYS,
    NUMBER_KEYS,
    OF_CAMERA,
    OF_WORLD,
    POSE_KEYS,
    RATE_KEYS,
    SEEN_KEYS,
    arrays_of,
    gender_in,
    holds_poses,
    unprefixed,
)
from bridge.motion.readers.tracks import chosen_person
from bridge.runs.untrusted import file_refused, inflated, open_regular

OF_MOSH = "_stageii"
"""How the names of MoSh++'s files end."""
_MOST_FILE_BYTES = 1 << 31
_MOST_OPCODES = 4_000_000
"""MoSh++'s names and markers of every frame are lists: 10,000 frames of 67 markers take 1.3
million."""
_AISTPP_FPS = 60.0
_3DPW, _3DPW_FPS = "poses_60Hz", 30.0
_OF_ALL = ("gender", *RATE_KEYS, *NUMBER_KEYS, *SEEN_KEYS)
"""What may be said of all that lies in a dictionary."""
_MOST_INFLATED_BYTES = 1 << 30
_MOST_PEOPLE = 10_000
_REMEDY = "Save its arrays as .npz."
_DEEPEST = 5
"""Of dictionaries and lists in one another."""
_DETAILS = "stageii_debug_details"


def is_moshs(path: Path) -> bool:
    """Whether a file is MoSh++'s, by its name."""
    return path.stem.lower().endswith(OF_MOSH)


def gender_of(path: Path) -> str | None:
    """The gender that a file states; the whole file is read. A damaged one is refused if it is
    MoSh++'s by its name."""
    try:
        with file_refused(path, unusable, _REMEDY):
            return gender_in_file(_opened(path))
    except DsnetError:
        if is_moshs(path):
            raise
        return None


def gender_in_file(stored: Any) -> str | None:
    """The gender of the first of the people in what a file holds; None where there are none."""
    people = (one for one in _people(stored) if not one.keys() & OF_CAMERA.keys())
    return next((gender_in(_gender(one)) for one in people), None)


def read(path: Path, how: HowRead = AS_IT_SAYS) -> Motion:
    """Read and check one file; of several people the one who is seen longest, or who is meant."""
    motion, people = motion_in(path, _opened(path), how)
    if is_moshs(path) or people[0].keys() & {_DETAILS, *OLDER}:
        motion = replace(motion, markers=MarkerFile(path, partial(from_mosh, people[0])))
    return motion


def motion_in(path: Path, stored: Any, how: HowRead) -> tuple[Motion, list[Mapping[str, Any]]]:
    """The motion in what a file holds, and all people in that."""
    with file_refused(path, unusable, _REMEDY):
        people = [*_people(stored)]
        whose = [OF_CAMERA[name] for one in people for name in one if name in OF_CAMERA]
    people = [one for one in people if not one.keys() & OF_CAMERA.keys()]
    if not people and whose:
        flaw = f"whose poses are in a camera's space alone, as {whose[0]}"
        raise unusable(path, flaw, "Export the world's space too.")
    with file_refused(path, unusable, _REMEDY):
        each = [one for one in map(_arrays, people) if holds_poses(one)]
        keys = (*POSE_KEYS, *BODY_KEYS)
        lengths = [next(len(one[key]) for key in keys if key in one) for one in each]
    if not each:
        raise unusable(path, "without poses of SMPL", "Pass the file of one motion.")
    if len(each) > 1 and max(lengths) == 1:
        flaw = f"of {len(each)} poses one by one: whether of frames or of people, it does not say"
        raise unusable(path, flaw, "Stack the frames of one person.")
    notes: list[str] = []
    if len(each) > 1:
        arrays = each[chosen_person(path, how, lengths, notes)]
        how = replace(how, person=None)
    else:
        (arrays,) = each
    motion = motion_of(path, arrays, how, _AISTPP_FPS if "smpl_scaling" in arrays else np.nan)
    return replace(motion, notes=(*notes, *motion.notes)), people


def _opened(path: Path) -> Any:
    """What a file holds."""
    with file_refused(path, unusable, _REMEDY), open_regular(path, _MOST_FILE_BYTES) as file:
        begins = file.read(2)
        file.seek(0)
        match begins:
            case b"PK":
                return load_torch(file)
            case b"\x93N":  # of an .npy
                return load_restricted_item(file)
            case b"x\x01" | b"x\x5e" | b"x\x9c" | b"x\xda" | b"\x1f\x8b":
                return load_restricted(inflated(file, _MOST_INFLATED_BYTES), _MOST_OPCODES)
            case b"BZ" | b"\xfd7" | b"]\0":
                raise ValueError("it is compressed by bz2 or lzma: unpack it")
        return load_restricted(file, _MOST_OPCODES)


def _people(
    stored: Any,
    of_all: Mapping[str, Any] | None = None,
    depth: int = _DEEPEST,
    met: set[int] | None = None,
) -> Iterator[Mapping[str, Any]]:
    """The dictionaries with poses in what a file holds; what it says of all holds for each. Those
    of a world alone where there are also a camera's."""
    met = set() if met is None else met
    if id(stored) in met:  # lists can hold one another a million times over
        return
    met.add(id(stored))
    person = unprefixed(_named(stored))
    world = next((person[key] for key in OF_WORLD if isinstance(person.get(key), dict)), None)
    of_all = {**(of_all or {}), **{key: person[key] for key in _OF_ALL if key in person}}
    if world is not None:
        yield from _people(world, of_all, depth - 1, met)
    elif "pose_world" in person or holds_poses(person):
        yield from _each({**of_all, **person})
    elif person.keys() & OF_CAMERA.keys():
        yield person
    elif depth:
        inner = [*person.values()] or stored
        for one in inner[:_MOST_PEOPLE] if isinstance(inner, list) else ():
            if isinstance(one, (dict, list)):
                yield from _people(one, of_all, depth - 1, met)


def _each(person: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """One after another where arrays are lists of people's."""
    lists = {name: value for name, value in person.items() if isinstance(value, list)}
    count = next((len(lists[key]) for key in POSE_KEYS if key in lists), None)
    if count is None:
        yield person
        return
    for row in range(min(count, _MOST_PEOPLE)):
        of_one = {name: value[row] for name, value in lists.items() if len(value) == count}
        yield {**person, **of_one}


def _named(stored: Any) -> dict[str, Any]:
    """A dictionary by text, of Python 2's bytes too; nothing of what is none."""
    given = stored if isinstance(stored, dict) else {}
    return {n.decode("latin1") if isinstance(n, bytes) else str(n): v for n, v in given.items()}


def _arrays(person: Mapping[str, Any]) -> dict[str, NDArray]:
    """By name; where a person has the world's and the camera's, the world's."""
    if "pose_world" in person:
        camera = dict.fromkeys((*POSE_KEYS, "trans"))
        world = {"pose": person["pose_world"], "trans": person.get("trans_world")}
        person = {**person, **camera, **world}
    rate = _3DPW_FPS if _3DPW in person else _rate(person.get(_DETAILS))
    person = {"mocap_frame_rate": rate, **person, "gender": _gender(person)}
    return arrays_of(person, strict=_DETAILS in person)


def _gender(person: Mapping[str, Any]) -> Any:
    """As it is stated, or as MoSh++ was configured."""
    configured = within(person, _DETAILS, "cfg", "surface_model", "gender")
    configured = plain_text(within(person, "ps", "gender") or configured)
    return person.get("gender", person.get("genders", configured))


def _rate(details: Any) -> float | None:
    """Of the frames that MoSh++ fitted, Hz."""
    rate, every = within(details, "mocap_frame_rate"), within(details, "cfg", "mocap", "ds_rate")
    if rate is None:
        return None
    number = rate if isinstance(rate, (int, float)) else as_array(rate).item()
    return number / (every if isinstance(every, int) and every > 0 else 1)
