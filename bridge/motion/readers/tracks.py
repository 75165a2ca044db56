"""Of several people in a file the one that is read, and the frames in which somebody was seen."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.motion.motion import HowRead
from bridge.motion.readers.joint_rotations import BODY_WIDTHS, WIDTHS, unusable
from bridge.motion.readers.smpl_fields import (
    BETAS_KEYS,
    BODY_KEYS,
    FLOOR_KEY,
    NUMBER_KEYS,
    PART_KEYS,
    POSE_KEYS,
    ROOT_KEYS,
    SEEN_KEYS,
    TRANS_KEYS,
    Arrays,
    first_of,
)

_OF_FRAMES = (*POSE_KEYS, *ROOT_KEYS, *BODY_KEYS, *PART_KEYS, *TRANS_KEYS, *NUMBER_KEYS,
              *SEEN_KEYS, "Rh", "dmpls")  # fmt: skip
"""Arrays with a row a frame."""
_LARGEST_NUMBER = 1e9
"""Of a frame."""


def of_one_person(path: Path, arrays: Arrays, how: HowRead, notes: list[str]) -> Arrays:
    """Where an axis of people, or of a batch, stands before that of frames."""
    key = first_of(arrays, (*POSE_KEYS, *BODY_KEYS))
    shape = arrays[key].shape if key else ()
    if len(shape) != 3 or shape[2] not in WIDTHS.keys() | BODY_WIDTHS or not shape[0]:
        chosen_person(path, how, [0], notes)
        return arrays
    people = shape[0]
    if people > 1 == shape[1]:
        flaw = f"whose {key!r} have shape {shape}: whether of frames or of people, it does not say"
        raise unusable(path, flaw, "Stack the frames of one person.")
    seen = arrays.get(first_of(arrays, SEEN_KEYS) or "", np.ones(shape[:2]))
    is_of_all = seen.shape == shape[:2] and seen.dtype.kind in "biuf"
    lengths = (seen > 0).sum(axis=1).tolist() if is_of_all else [shape[1]] * people
    chosen = chosen_person(path, how, lengths, notes)
    keys = (*_OF_FRAMES, *BETAS_KEYS, FLOOR_KEY)
    each = {k: v for k, v in arrays.items() if k in keys and v.ndim > 1 and len(v) == people}
    return {**arrays, **{name: array[chosen] for name, array in each.items()}}


def chosen_person(path: Path, how: HowRead, lengths: Sequence[int], notes: list[str]) -> int:
    """Which of several people is read, from 0: whom the user says, else who is seen longest.

    `lengths` are their frames.
    """
    count = len(lengths)
    if how.person is not None and not 1 <= how.person <= count:
        people = "one person" if count == 1 else f"{count} people"
        raise unusable(
            path, f"which holds {people}, and not person {how.person}", f"Say 1 to {count}."
        )
    chosen = int(np.argmax(lengths)) if how.person is None else how.person - 1
    if count > 1:
        notes.append(
            f"{path} holds {count} people: person {chosen + 1}, of {lengths[chosen]} frames, is "
            "read; --person of `dsnet predict` says another"
        )
    return chosen


def frames_seen(
    path: Path, arrays: Arrays, notes: list[str]
) -> tuple[Arrays, NDArray[np.intp] | None]:
    """The arrays of frames in which somebody was seen, in order of time, and which of the recording
    these are, where some between them are missing."""
    key = first_of(arrays, (*POSE_KEYS, *BODY_KEYS))
    count = len(arrays[key]) if key and arrays[key].ndim else 0
    numbers, seen = np.arange(count), np.ones(count, bool)
    if (key := first_of(arrays, NUMBER_KEYS)) and arrays[key].size == count > 1:
        stated = arrays[key].ravel()
        is_whole = stated.dtype.kind in "iuf" and (np.abs(stated) < _LARGEST_NUMBER).all()
        if is_whole and len(np.unique(np.trunc(stated))) == count:
            numbers = stated.astype(np.intp)
        else:
            notes.append(f"{path} has {key!r} that number no frames: they are taken one by one")
    if (
        (key := first_of(arrays, SEEN_KEYS))
        and arrays[key].size == count
        and (arrays[key].dtype.kind in "biuf")
    ):
        seen = arrays[key].ravel() > 0
        if not seen.any():
            raise unusable(path, f"whose {key!r} says that nobody was seen")
        if ends := [one for one in (seen.argmax(), seen[::-1].argmax()) if one]:
            notes.append(f"{path} sees nobody in {sum(ends)} frames at its ends: they are left out")
    rows = np.argsort(numbers, kind="stable")
    rows = rows[seen[rows]]
    of_all = {k: v for k, v in arrays.items() if v.ndim and len(v) == count}
    betas = {k for k in of_all if k in BETAS_KEYS and of_all[k].ndim > 1 < of_all[k].shape[1]}
    of_all = {k: v for k, v in of_all.items() if k in _OF_FRAMES or k in betas}
    gaps = np.diff(numbers[rows]) > 1
    return (
        {**arrays, **{name: array[rows] for name, array in of_all.items()}},
        numbers[rows] if gaps.any() else None,
    )
