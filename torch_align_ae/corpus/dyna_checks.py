"""What a Dyna or D-FAUST file must hold, names, shapes, metres, y up, and what it may declare.

Dyna's `dyna_{female,male}.h5` and D-FAUST's `registrations_{f,m}.hdf5` have one layout: a data set
`{subject}_{motion}` of shape (6890, 3, T) for each sequence, at 60 fps, and `faces` (13776, 3).
Strangers write such files: all that is declared is checked before HDF5 reserves memory for it or
opens another file.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from bridge.body.model_data import FACE_COUNT
from bridge.errors import DsnetError
from bridge.paper import N_VERTICES

FACES_KEY = "faces"
LAYOUT = "Dyna or D-FAUST registrations: {subject}_{motion} (6890, 3, T) in metres, y up"
REMEDY = "Download the file again from dyna.is.tue.mpg.de, or write it with `dsnet corpus`."

_MOST_ITEMS = 10_000
_MOST_CHUNK_BYTES = 256 << 20
"""HDF5 reads whole chunks: this is a sequence of 1600 frames in one."""
_NAME = re.compile(r"[\w.+-]+( [\w.+-]+)*")
_MOST_NAME = 100
_MOST_FRAMES = 36_000
"""Of a sequence: ten minutes."""
# Across, people are 1 to 2.2 m; another unit is named after the same people in it.
_PERSON_M = (0.5, 5.0)
_USUAL_M = 1.7
_UNITS = {"millimetres": 1000, "centimetres": 100, "inches": 1 / 0.0254}
_FARTHEST_M = 100.0
"""From the origin: farther off, float32 loses tenths of a millimetre."""
# On average, of a person; vertices in another order lie decimetres apart.
_LONGEST_EDGE_M = 0.1
_LEAST_HEIGHT = 0.5
"""Of the width: a crouch with both arms spread has it; who lies, or stands along z, has a third."""


@dataclass(frozen=True)
class DynaEntry:
    """One sequence of a file, the data set `name`: `<subject>_<motion>`."""

    name: str
    subject: str  # what stands before the first underscore
    motion: str  # the rest: `one_leg_jump`, but also `running_on_spot_bugfix`
    length: int  # frames, at least 1
    path: Path


def check_items(path: Path, file: h5py.File) -> None:
    """Refuse a file with names that are none, or whose items lie in other files."""
    if len(file) > _MOST_ITEMS:
        raise DsnetError(f"{path}: {len(file)} items", f"at most {_MOST_ITEMS}", REMEDY)
    for name in map(str, file):
        if len(name) > _MOST_NAME or not _NAME.fullmatch(name):
            expected = f"letters, digits, points and dashes, at most {_MOST_NAME}"
            raise DsnetError(f"{path}: an item named {name[:_MOST_NAME]!r}", expected, "Rename it.")
        if not isinstance(file.get(name, getlink=True), h5py.HardLink):
            raise DsnetError(f"{path}: {name}, a link", "data in the file itself", REMEDY)


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
    """The sequence that a data set holds; refused if it is none, or lies not whole in the file."""
    _check_place(path, name, dataset)
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
        received = f"{path}: {name} has zero frames"
        raise DsnetError(received, "at least one", "Leave out that sequence.")
    # HDF5 reads as 0 what a file declares and does not hold.
    if dataset.chunks is None:
        is_stored = dataset.id.get_storage_size() >= dataset.nbytes
    else:
        sizes = zip(dataset.shape, dataset.chunks, strict=True)
        chunks = math.prod(-(-size // chunk) for size, chunk in sizes)
        is_stored = dataset.id.get_num_chunks() >= chunks
    if not is_stored:
        received = f"{path}: {name} declares {length} frames, not all of which the file holds"
        raise DsnetError(received, "a file that was written to its end", REMEDY)
    if length > _MOST_FRAMES:
        received = f"{path}: {name} has {length} frames"
        raise DsnetError(received, f"at most {_MOST_FRAMES}", "Cut it into several sequences.")
    return DynaEntry(name, subject, motion, length, path)


def faces_of(path: Path, item: Any) -> NDArray[np.int64] | None:
    """(13776, 3) the faces that a file states, or None where it states none."""
    if item is None:
        return None
    expected = f"({FACE_COUNT}, 3) indices of {N_VERTICES} vertices"
    is_table = isinstance(item, h5py.Dataset) and item.shape == (FACE_COUNT, 3)
    if not is_table or item.dtype.kind not in "iuf":
        raise DsnetError(f"{path}: {FACES_KEY} that are no faces", expected, REMEDY)
    _check_place(path, FACES_KEY, item)
    faces = np.asarray(item)
    if not ((faces >= 0) & (faces < N_VERTICES) & (faces % 1 == 0)).all():
        raise DsnetError(f"{path}: {FACES_KEY} that point at no vertex", expected, REMEDY)
    return faces.astype(np.int64)


def _check_place(path: Path, name: str, dataset: h5py.Dataset) -> None:
    """Refuse a data set that lies in other files, or is too large to be read piece by piece."""
    if dataset.is_virtual or dataset.external:
        raise DsnetError(f"{path}: {name}, whose data lie elsewhere", "data in the file", REMEDY)
    chunk_bytes = math.prod(dataset.chunks or (0,)) * dataset.dtype.itemsize
    if chunk_bytes > _MOST_CHUNK_BYTES:
        raise DsnetError(
            f"{path}: {name} in chunks of {chunk_bytes} bytes",
            f"at most {_MOST_CHUNK_BYTES}",
            f"Repack it: h5repack -l {name}:CHUNK={N_VERTICES}x3x16 IN OUT.",
        )


def check_frames(path: Path, name: str, start: int, frames: NDArray[np.float32]) -> None:
    """Check that frames (n, 6890, 3) of a sequence, from `start` on, are a person in metres."""
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
        received = f"{path}: {name} has NaN or infinite vertices in frame {start + bad}"
        raise DsnetError(received, "finite vertices", "Repair or leave out that sequence.")
    received = f"{path}: {name} in frame {start + bad}"
    if is_person[bad]:
        raise DsnetError(
            f"{received} is {off_m[bad]:.4g} m off",
            f"a person within {_FARTHEST_M:g} m of the origin",
            "Subtract the place of the first frame from all frames.",
        )
    # The unit in which the extent is nearest to a person's, if it is near one.
    unit, per_m = min(_UNITS.items(), key=lambda item: abs(extent[bad] / item[1] - _USUAL_M))
    remedy = "Convert it to metres."
    if _PERSON_M[0] < extent[bad] / per_m < _PERSON_M[1]:
        remedy = f"It seems to be in {unit}: divide it by {per_m:g}."
    raise DsnetError(f"{received} {_measures(size[bad])}", "a person in metres", remedy)


def check_standing(
    path: Path, name: str, vertices: NDArray[np.float32], faces: NDArray[np.int64] | None
) -> None:
    """Check that a sequence's first frame (6890, 3) has y up, and its file's faces outside."""
    size = np.ptp(vertices, axis=0)
    if size[1] < _LEAST_HEIGHT * size.max():
        axis = "xyz"[int(size.argmax())]
        raise DsnetError(
            f"{path}: {name} {_measures(size)}",
            "a person upright along y",
            f"It is {axis} up, or it lies: turn the meshes (from z up: (x, y, z) to (x, z, -y)).",
        )
    if faces is None:
        return
    first, second, third = np.asarray(vertices, np.float64)[faces].swapaxes(0, 1)
    edges_m = np.linalg.norm(first - second, axis=1)
    if not edges_m.mean() < _LONGEST_EDGE_M:
        raise DsnetError(
            f"{path}: {name}, whose triangles' edges measure {100 * edges_m.mean():.0f} cm",
            "meshes with SMPL's vertex order",
            "Register the meshes to SMPL's template.",
        )
    if not (np.cross(first, second) * third).sum() > 0:  # the volume that they enclose
        raise DsnetError(
            f"{path}: {name} is inside out",
            "faces wound counter-clockwise seen from outside",
            "It is mirrored, or its faces are: negate an axis, or turn the faces round.",
        )


def _measures(size: NDArray[np.float32]) -> str:
    return f"measures {size[0]:.4g} x {size[1]:.4g} x {size[2]:.4g} (x, y, z)"
