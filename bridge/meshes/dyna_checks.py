"""What a Dyna or D-FAUST file must hold, names, shapes, metres, y up, and what it may declare.

Dyna's `dyna_{female,male}.h5` and D-FAUST's `registrations_{f,m}.hdf5` have one layout: a data set
`{subject}_{motion}` of shape (6890, 3, T) for each sequence, at 60 fps, and `faces` (13776, 3).
Strangers write such files: all that is declared is checked before HDF5 reserves memory for it or
opens another file.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from bridge.body.model_data import FACE_COUNT
from bridge.body.surface_operators import volume_m3
from bridge.errors import DsnetError
from bridge.paper import FPS, N_VERTICES

FACES_KEY = "faces"
LAYOUT = "Dyna or D-FAUST registrations: {subject}_{motion} (6890, 3, T) in metres, y up, 60 fps"
REMEDY = "Download the file again from dyna.is.tue.mpg.de, or write it with `dsnet corpus`."

_MOST_ITEMS = 10_000
_MOST_CHUNK_BYTES = 256 << 20  # HDF5 reads whole chunks: a sequence of 1600 frames in one
_NAME = re.compile(r"[\w.+-]+( [\w.+-]+)*")
_MOST_NAME = 100
_RATES = {"fps", "framerate", "frame_rate", "mocap_framerate"}
_MOST_FRAMES = 36_000  # of a sequence: ten minutes
# Across, people are 1 to 2.2 m; another unit is named after the same people in it.
_PERSON_M = (0.5, 5.0)
_USUAL_M = 1.7
_UNITS = {"millimetres": 1000, "centimetres": 100, "inches": 1 / 0.0254}
_FARTHEST_M = 100.0  # from the origin: farther off, float32 loses tenths of a millimetre
# On average, of a person; vertices in another order lie decimetres apart.
_LONGEST_EDGE_M = 0.1
# Of the width: a crouch with both arms spread has it; who lies, or stands along z, has a third.
_LEAST_HEIGHT = 0.5


def _require(holds: object, received: str, expected: str, remedy: str = REMEDY) -> None:
    if not holds:
        raise DsnetError(received, expected, remedy)


def check_items(path: Path, file: h5py.File) -> None:
    """Refuse a file with names that are none, or whose items lie in other files."""
    _require(len(file) <= _MOST_ITEMS, f"{path}: {len(file)} items", f"at most {_MOST_ITEMS}")
    characters = f"letters, digits, points and dashes, at most {_MOST_NAME}"
    for name in map(str, file):
        received = f"{path}: an item named {name[:_MOST_NAME]!r}"
        is_name = len(name) <= _MOST_NAME and _NAME.fullmatch(name)
        _require(is_name, received, characters, "Rename it.")
        is_here = isinstance(file.get(name, getlink=True), h5py.HardLink)
        _require(is_here, f"{path}: {name}, a link", "data in the file itself")


def is_sequence(name: str, item: object) -> bool:
    """Whether an item of a file is meant to be a sequence: no list of names is assumed.

    That is each data set named after a subject or of three dimensions or more; `check_sequence`
    refuses those that are none, which would be missed by nobody if they were left out here.
    """
    subject, _, motion = name.partition("_")
    named_after_subject = subject.isdecimal() and bool(motion)
    if name == FACES_KEY or not isinstance(item, h5py.Dataset):
        return False
    return named_after_subject or item.ndim >= 3


def check_sequence(path: Path, name: str, dataset: h5py.Dataset) -> int:
    """Frames of the sequence that a data set holds; refused if it is none, or lies not whole in
    the file."""
    _check_place(path, name, dataset)
    subject, _, motion = name.partition("_")
    _require(subject and motion, f"{path}: sequence {name!r}", "a name <subject>_<motion>")
    *vertex_axes, length = dataset.shape or [0]
    _require(
        vertex_axes == [N_VERTICES, 3] and dataset.dtype.kind == "f",
        f"{path}: {name} has shape {dataset.shape} of {dataset.dtype}",
        f"({N_VERTICES}, 3, T) of float32 or float64",
        "Use meshes registered to SMPL's template.",
    )
    _require(length, f"{path}: {name} has zero frames", "at least one", "Leave out that sequence.")
    # HDF5 reads as 0 what a file declares and does not hold.
    if dataset.chunks is None:
        is_stored = dataset.id.get_storage_size() >= dataset.nbytes
    else:
        sizes = zip(dataset.shape, dataset.chunks, strict=True)
        is_stored = dataset.id.get_num_chunks() >= math.prod(-(-n // chunk) for n, chunk in sizes)
    received = f"{path}: {name} declares {length} frames, not all of which the file holds"
    _require(is_stored, received, "a file that was written to its end")
    received, remedy = f"{path}: {name} has {length} frames", "Cut it into several sequences."
    _require(length <= _MOST_FRAMES, received, f"at most {_MOST_FRAMES}", remedy)
    for owner in (dataset, dataset.file):
        for said in _RATES & set(owner.attrs):
            stored = owner.attrs.get_id(said)
            if stored.shape in ((), (1,)) and stored.dtype.kind in "iuf":
                fps = np.asarray(owner.attrs[said], np.float64).item()
                received = f"{path}: {name} with {said} {fps:g}"
                _require(fps == FPS, received, f"{FPS:g}", "Resample the meshes.")
    return length


def read_faces(path: Path, item: Any) -> NDArray[np.int64] | None:
    """(13776, 3) the faces that a file states, or None where it states none."""
    if item is None:
        return None
    expected = f"({FACE_COUNT}, 3) indices of {N_VERTICES} vertices"
    is_table = isinstance(item, h5py.Dataset) and item.shape == (FACE_COUNT, 3)
    are_numbers = is_table and item.dtype.kind in "iuf"
    _require(are_numbers, f"{path}: {FACES_KEY} that are no faces", expected)
    _check_place(path, FACES_KEY, item)
    faces = np.asarray(item)
    are_vertices = ((faces >= 0) & (faces < N_VERTICES) & (faces % 1 == 0)).all()
    _require(are_vertices, f"{path}: {FACES_KEY} that point at no vertex", expected)
    return faces.astype(np.int64)


def _check_place(path: Path, name: str, dataset: h5py.Dataset) -> None:
    """Refuse a data set that lies in other files, or is too large to be read piece by piece."""
    is_here = not (dataset.is_virtual or dataset.external)
    _require(is_here, f"{path}: {name}, whose data lie elsewhere", "data in the file")
    chunk_bytes = math.prod(dataset.chunks or (0,)) * dataset.dtype.itemsize
    _require(
        chunk_bytes <= _MOST_CHUNK_BYTES,
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
    received = f"{path}: {name} has NaN or infinite vertices in frame {start + bad}"
    remedy = "Repair or leave out that sequence."
    _require(np.isfinite(frames[bad]).all(), received, "finite vertices", remedy)
    received = f"{path}: {name} in frame {start + bad}"
    _require(
        not is_person[bad],
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
    _require(
        size[1] >= _LEAST_HEIGHT * size.max(),
        f"{path}: {name} {_measures(size)}",
        "a person upright along y",
        f"It is {'xyz'[int(size.argmax())]} up, or it lies: turn the meshes"
        " (from z up: (x, y, z) to (x, z, -y)).",
    )
    if faces is None:
        return
    corners = np.asarray(vertices, np.float64)[faces]
    edge_m = np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1).mean()
    _require(
        edge_m < _LONGEST_EDGE_M,
        f"{path}: {name}, whose triangles' edges measure {100 * edge_m:.0f} cm",
        "meshes with SMPL's vertex order",
        "Register the meshes to SMPL's template.",
    )
    _require(
        volume_m3(np.asarray(vertices, np.float64), faces) > 0,
        f"{path}: {name} is inside out",
        "faces wound counter-clockwise seen from outside",
        "It is mirrored, or its faces are: negate an axis, or turn the faces round.",
    )


def _measures(size: NDArray[np.float32]) -> str:
    return f"measures {size[0]:.4g} x {size[1]:.4g} x {size[2]:.4g} (x, y, z)"
