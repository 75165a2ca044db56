"""A mesh in bands of colour: viser's meshes that can move have one colour each.

So a body is as many meshes as there are bands, and a face belongs to the band of its value, the
mean over its corners.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

CLAY = (219, 201, 186)
COLOURS = (
    (252, 240, 178), (254, 196, 136), (253, 154, 106), (246, 110, 92), (224, 76, 103),
    (188, 57, 120), (150, 44, 128), (114, 31, 129), (76, 17, 122), (37, 18, 85),
)  # fmt: skip
"""The report's colours of sizes, from none to `full_m` and more."""
BANDS = len(COLOURS)


def faces_by_band(
    faces: NDArray[np.uint32], values_m: NDArray[np.floating], full_m: float
) -> list[NDArray[np.uint32]]:
    """The faces (F, 3) of a mesh in bands of equal width from 0 to `full_m`.

    Parameters
    ----------
    values_m : (V,) what the colours show, at each vertex, metres.
    full_m : from which on a face has the last colour, metres.
    """
    first, second, third = values_m[faces.T]
    of_face = (first + second + third) / 3
    band = np.minimum((of_face * (BANDS / full_m)).astype(np.int64), BANDS - 1)
    order = np.argsort(band, kind="stable")
    ends = np.cumsum(np.bincount(band, minlength=BANDS))[:-1]
    return np.split(faces[order], ends)


def own_vertices(
    faces: NDArray[np.uint32], count: int
) -> tuple[NDArray[np.intp], NDArray[np.uint32]]:
    """Which of `count` vertices faces (F, 3) have, ascending, and the same faces among those."""
    used = np.zeros(count, bool)
    used[faces] = True
    places = np.cumsum(used, dtype=np.uint32) - np.uint32(1)
    return np.flatnonzero(used), places[faces]


def band_edges_cm(full_m: float) -> NDArray[np.floating]:
    """(BANDS + 1,) where the bands begin and the last ends, centimetres."""
    return np.linspace(0.0, 100.0 * full_m, BANDS + 1)
