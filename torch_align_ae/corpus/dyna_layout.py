"""What a Dyna or D-FAUST file must hold: names, shapes, metres, y up; and whose meshes are in it.

Dyna's `dyna_{female,male}.h5` and D-FAUST's `registrations_{f,m}.hdf5` have one layout: a data set
`{subject}_{motion}` of shape (6890, 3, T) for each sequence, at 60 fps, and `faces` (13776, 3).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError, notify
from bridge.paper import N_VERTICES

FPS = 60.0
# Each gender is aligned and trained apart (Section 3.2).
DYNA_SUBJECTS = {
    "female": ("50004", "50020", "50021", "50022", "50025"),
    "male": ("50002", "50007", "50009", "50026", "50027"),
}
_OTHER = {"female": "male", "male": "female"}
FACES_KEY = "faces"
LAYOUT = "Dyna or D-FAUST registrations: {subject}_{motion} (6890, 3, T) in metres, y up"
REMEDY = "Download the file again from dyna.is.tue.mpg.de, or write it with `dsnet corpus`."

# Across, people are 1 to 2.2 m; another unit is named after the same people in it.
_PERSON_M = (0.5, 5.0)
_USUAL_M = 1.7
_MOST_FRAMES = 36_000
"""Of a sequence: ten minutes."""
_FARTHEST_M = 100.0
"""From the origin: farther off, float32 loses tenths of a millimetre."""
_UNITS = {"millimetres": 1000, "centimetres": 100, "inches": 1 / 0.0254}
# A crouch with both arms spread is half as tall as wide; who lies, or stands along z, is a third.
_LEAST_HEIGHT = 0.5


@dataclass(frozen=True)
class DynaEntry:
    """One sequence of a file."""

    name: str
    """The data set's key, `<subject>_<motion>`."""
    subject: str
    """Subject identifier, the part before the first underscore."""
    motion: str
    """Motion name, the rest: `one_leg_jump`, but also `running_on_spot_bugfix`."""
    length: int
    """Number of frames, at least 1."""
    path: Path
    """The file it lies in."""


def is_sequence(name: str, item: object) -> bool:
    """Whether an item of a file means to be a sequence: keys are found, not assumed.

    That is each data set named after a subject or of three dimensions or more; `entry_of` refuses
    those that are none, which would be missed by nobody if they were left out here.
    """
    subject, _, motion = name.partition("_")
    named_after_subject = subject.isdecimal() and bool(motion)
    return (
        name != FACES_KEY
        and isinstance(item, h5py.Dataset)
        and (named_after_subject or item.ndim >= 3)
    )


def entry_of(path: Path, name: str, dataset: h5py.Dataset) -> DynaEntry:
    """The sequence that a data set holds.

    Raises
    ------
    DsnetError
        If its name, shape or type is not Dyna's, or the file does not hold its frames.
    """
    subject, _, motion = name.partition("_")
    if not (subject and motion):
        raise DsnetError(f"{path}: sequence {name!r}", "a name <subject>_<motion>", REMEDY)
    *vertex_axes, length = dataset.shape or [0]
    if vertex_axes != [N_VERTICES, 3] or dataset.dtype.kind != "f":
        raise DsnetError(
            f"{path}: {name} has shape {dataset.shape} of {dataset.dtype}",
            f"({N_VERTICES}, 3, T) of float32 or float64",
            "Use meshes registered to SMPL's template.",
        )
    if not length:
        raise DsnetError(
            f"{path}: {name} has zero frames", "at least one", "Leave out that sequence."
        )
    if not _is_stored(dataset):
        raise DsnetError(
            f"{path}: {name} declares {length} frames, not all of which the file holds",
            "a file that was written to its end",
            REMEDY,
        )
    if length > _MOST_FRAMES:
        raise DsnetError(
            f"{path}: {name} has {length} frames",
            f"at most {_MOST_FRAMES}",
            "Cut it into several sequences.",
        )
    return DynaEntry(name, subject, motion, length, path)


def _is_stored(dataset: h5py.Dataset) -> bool:
    """Whether the file has the bytes that a data set's shape declares; HDF5 reads others as 0."""
    if dataset.chunks is None:
        return dataset.id.get_storage_size() >= dataset.nbytes
    grid = [-(-size // chunk) for size, chunk in zip(dataset.shape, dataset.chunks, strict=True)]
    return dataset.id.get_num_chunks() >= math.prod(grid)


def check_frames(path: Path, name: str, start: int, frames: NDArray[np.float32]) -> None:
    """Check that frames (n, 6890, 3) of a sequence, from `start` on, are a person in metres.

    Raises
    ------
    DsnetError
        If a vertex is not finite, or a frame's extent is not a person's.
    """
    # A maximum and a minimum are not finite where a vertex is not, and cost one pass each.
    with np.errstate(invalid="ignore", over="ignore"):
        most, least = frames.max(1), frames.min(1)
        size, off_m = most - least, np.maximum(most, -least).max(1)
    extent = size.max(1)
    is_person = (_PERSON_M[0] < extent) & (extent < _PERSON_M[1])
    fits = is_person & (off_m < _FARTHEST_M)
    if fits.all():
        return
    bad = int(np.argmin(fits))
    if not np.isfinite(frames[bad]).all():
        raise DsnetError(
            f"{path}: {name} has NaN or infinite vertices in frame {start + bad}",
            "finite vertices",
            "Repair or leave out that sequence.",
        )
    if is_person[bad]:
        raise DsnetError(
            f"{path}: {name} in frame {start + bad} is {off_m[bad]:.4g} m off",
            f"a person within {_FARTHEST_M:g} m of the origin",
            "Subtract the place of the first frame from all frames.",
        )
    raise DsnetError(
        f"{path}: {name} in frame {start + bad} {_measures(size[bad])}",
        "a person in metres",
        _unit_remedy(float(extent[bad])),
    )


def check_upright(path: Path, name: str, vertices: NDArray[np.float32]) -> None:
    """Check that a sequence's first frame (6890, 3) has y up.

    Raises
    ------
    DsnetError
        If it is less than half as high as wide.
    """
    size = np.ptp(vertices, axis=0)
    if size[1] < _LEAST_HEIGHT * size.max():
        axis = "xyz"[int(size.argmax())]
        raise DsnetError(
            f"{path}: {name} {_measures(size)}",
            "a person upright along y",
            f"It is {axis} up, or it lies: turn the meshes (from z up: (x, y, z) to (x, z, -y)).",
        )


def _measures(size: NDArray[np.float32]) -> str:
    return f"measures {size[0]:.4g} x {size[1]:.4g} x {size[2]:.4g} (x, y, z)"


def _unit_remedy(extent: float) -> str:
    """The unit in which the extent is nearest to a person's, if it is near one."""
    unit, per_m = min(_UNITS.items(), key=lambda item: abs(extent / item[1] - _USUAL_M))
    if _PERSON_M[0] < extent / per_m < _PERSON_M[1]:
        return f"It seems to be in {unit}: divide it by {per_m:g}."
    return "Convert it to metres."


def of_one_gender(entries: Sequence[DynaEntry], gender: str) -> list[DynaEntry]:
    """The sequences that a body model of `gender` fits; subjects who are not Dyna's are kept.

    Sequences of the other gender are left out, and a line on stderr says how many, so that
    `--dyna dyna_female.h5 dyna_male.h5` serves either body model.

    Raises
    ------
    DsnetError
        If nothing remains, or if the body model's gender cannot choose between women and men.
    """
    strangers = set(DYNA_SUBJECTS.get(_OTHER.get(gender, ""), ()))
    kept = [entry for entry in entries if entry.subject not in strangers]
    subjects = {entry.subject for entry in entries}
    if not kept:
        raise DsnetError(
            f"subjects {sorted(subjects)}, who are {_OTHER[gender]}, with a {gender} body model",
            f"Dyna's {gender} subjects {', '.join(DYNA_SUBJECTS[gender])}",
            f"Pass the {_OTHER[gender]} body model, or the {gender} mesh file.",
        )
    if not strangers and all(subjects & set(known) for known in DYNA_SUBJECTS.values()):
        raise DsnetError(
            f"women and men ({', '.join(sorted(subjects))}) with a body model of gender {gender}",
            "one gender a run, as in the paper",
            "Pass SMPL's female or male model, or mesh files of one gender.",
        )
    if left_out := len(entries) - len(kept):
        why = f"{_OTHER[gender]} subjects, {gender} body model"
        notify(f"{left_out} of {len(entries)} sequences left out: {why}")
    return kept
