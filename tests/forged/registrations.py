"""Mesh files as Dyna and D-FAUST distribute them, whatever their chunks and float type."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray


def save_registrations(
    path: Path,
    sequences: Mapping[str, NDArray],
    faces: NDArray | None = None,
    dtype: str = "f8",
    **layout: Any,
) -> Path:
    """Write frames-first sequences (T, 6890, 3) vertices-first; `layout` goes to h5py."""
    with h5py.File(path, "w") as file:
        for name, frames in sequences.items():
            file.create_dataset(name, data=np.moveaxis(frames, 0, -1).astype(dtype), **layout)
        if faces is not None:
            file.create_dataset("faces", data=faces.astype(np.uint32))
    return path
