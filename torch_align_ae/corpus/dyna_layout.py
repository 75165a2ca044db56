"""What a Dyna or D-FAUST file must hold: names, shapes, metres, y up.

Dyna's `dyna_{female,male}.h5` and D-FAUST's `registrations_{f,m}.hdf5` have one layout: a data set
`{subject}_{motion}` of shape (6890, 3, T) for each sequence, at 60 fps, and `faces` (13776, 3).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from bridge.body.model_data import VERTEX_COUNT
from bridge.errors import DsnetError

FPS = 60.0
FACES_KEY = "faces"
LAYOUT = "Dyna or D-FAUST registrations: {subject}_{motion} (6890, 3, T) in metres, y up"
REMEDY = "Download the file again from dyna.is.tue.mpg.de, or write it with `dsnet corpus`."

# Across, people are 1 to 2.2 m; another unit is named after the same people in it.
_PERSON_M = (0.5, 5.0)
_USUAL_M = 1.7
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
    """Whether an item of a file is a sequence: keys are found, not assumed."""
    return name != FACES_KEY and isinstance(item, h5py.Dataset) and item.ndim == 3


def entry_of(path: Path, name: str, dataset: h5py.Dataset) -> DynaEntry:
    """The sequence that a data set holds.

    Raises
    ------
    DsnetError
        If its name, shape or type is not Dyna's, or it has no frames.
    """
    subject, _, motion = name.partition("_")
    if not (subject and motion):
        raise DsnetError(f"{path}: sequence {name!r}", "a name <subject>_<motion>", REMEDY)
    vertex_count, axes, length = dataset.shape
    if (vertex_count, axes) != (VERTEX_COUNT, 3) or dataset.dtype.kind != "f":
        raise DsnetError(
            f"{path}: {name} has shape {dataset.shape} of {dataset.dtype}",
            f"({VERTEX_COUNT}, 3, T) of float32 or float64",
            "Use meshes registered to SMPL's template.",
        )
    if not length:
        raise DsnetError(
            f"{path}: {name} has zero frames", "at least one", "Leave out that sequence."
        )
    return DynaEntry(name, subject, motion, length, path)


def check_bounding_box(path: Path, name: str, vertices: NDArray[np.float32]) -> None:
    """Check that a frame (6890, 3) is a person in metres with y up.

    Raises
    ------
    DsnetError
        If its extent is not a person's, or it is less than half as high as wide.
    """
    size = np.ptp(vertices, axis=0)
    extent = float(size.max())
    described = f"{path}: {name} measures {size[0]:.4g} x {size[1]:.4g} x {size[2]:.4g} (x, y, z)"
    if not _PERSON_M[0] < extent < _PERSON_M[1]:
        raise DsnetError(described, "a person in metres", _unit_remedy(extent))
    if size[1] < _LEAST_HEIGHT * extent:
        axis = "xyz"[int(size.argmax())]
        raise DsnetError(
            described,
            "a person upright along y",
            f"It is {axis} up, or it lies: turn the meshes (from z up: (x, y, z) to (x, z, -y)).",
        )


def _unit_remedy(extent: float) -> str:
    """The unit in which the extent is nearest to a person's, if it is near one."""
    unit, per_m = min(_UNITS.items(), key=lambda item: abs(extent / item[1] - _USUAL_M))
    if _PERSON_M[0] < extent / per_m < _PERSON_M[1]:
        return f"It seems to be in {unit}: divide it by {per_m:g}."
    return "Convert it to metres."
