"""What a mesh file may declare: checked before HDF5 reserves memory or opens another file."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from bridge.body.model_data import FACE_COUNT
from bridge.errors import DsnetError
from bridge.paper import N_VERTICES
from torch_align_ae.corpus.dyna_layout import FACES_KEY, REMEDY

_MOST_ITEMS = 10_000
_MOST_CHUNK_BYTES = 256 << 20
"""HDF5 reads whole chunks: this is a sequence of 1600 frames in one."""
_NAME = re.compile(r"[\w.+-]+( [\w.+-]+)*")
_MOST_NAME = 100


def check_own(path: Path, file: h5py.File) -> None:
    """Refuse a file with names that are none, or whose items lie in other files.

    Raises
    ------
    DsnetError
        If it has such an item.
    """
    if len(file) > _MOST_ITEMS:
        raise DsnetError(f"{path}: {len(file)} items", f"at most {_MOST_ITEMS}", REMEDY)
    for name in map(str, file):
        if len(name) > _MOST_NAME or not _NAME.fullmatch(name):
            expected = f"letters, digits, points and dashes, at most {_MOST_NAME}"
            raise DsnetError(f"{path}: an item named {name[:_MOST_NAME]!r}", expected, "Rename it.")
        if not isinstance(file.get(name, getlink=True), h5py.HardLink):
            raise DsnetError(f"{path}: {name}, a link", "data in the file itself", REMEDY)


def check_bounds(path: Path, name: str, dataset: h5py.Dataset) -> None:
    """Refuse a data set that lies in other files, or is too large to be read piece by piece.

    Raises
    ------
    DsnetError
        If it is.
    """
    if dataset.is_virtual or dataset.external:
        raise DsnetError(f"{path}: {name}, whose data lie elsewhere", "data in the file", REMEDY)
    chunk_bytes = math.prod(dataset.chunks or (0,)) * dataset.dtype.itemsize
    if chunk_bytes > _MOST_CHUNK_BYTES:
        raise DsnetError(
            f"{path}: {name} in chunks of {chunk_bytes} bytes",
            f"at most {_MOST_CHUNK_BYTES}",
            f"Repack it: h5repack -l {name}:CHUNK={N_VERTICES}x3x16 IN OUT.",
        )


def check_sides(path: Path, name: str, vertices: NDArray, faces: NDArray[np.int64] | None) -> None:
    """Refuse a mesh (6890, 3) that its file's own faces turn inside out.

    Raises
    ------
    DsnetError
        If they enclose no volume: the mesh is mirrored, or the faces are.
    """
    if faces is None:
        return
    first, second, third = np.asarray(vertices, np.float64)[faces].swapaxes(0, 1)
    if not (np.cross(first, second) * third).sum() > 0:
        raise DsnetError(
            f"{path}: {name} is inside out",
            "faces wound counter-clockwise seen from outside",
            "It is mirrored, or its faces are: negate an axis, or turn the faces round.",
        )


def faces_of(path: Path, item: Any) -> NDArray[np.int64] | None:
    """(13776, 3) the faces that a file states, or None where it states none.

    Raises
    ------
    DsnetError
        If they are not SMPL's in number, or no indices of vertices.
    """
    if item is None:
        return None
    expected = f"({FACE_COUNT}, 3) indices of {N_VERTICES} vertices"
    if (
        not isinstance(item, h5py.Dataset)
        or item.shape != (FACE_COUNT, 3)
        or item.dtype.kind not in "iuf"
    ):
        raise DsnetError(f"{path}: {FACES_KEY} that are no faces", expected, REMEDY)
    check_bounds(path, FACES_KEY, item)
    faces = np.asarray(item)
    if not ((faces >= 0) & (faces < N_VERTICES) & (faces % 1 == 0)).all():
        raise DsnetError(f"{path}: {FACES_KEY} that point at no vertex", expected, REMEDY)
    return faces.astype(np.int64)
