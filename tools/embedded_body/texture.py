"""MakeHuman's texture coordinates on an embedded body, so that its CC0 pictures of skin fit.

Vertices of the body are some of MakeHuman's, which have several places on the picture at its
seams. A face takes the places that lie nearest together. About one in a hundred lies across a
seam, where none do: there the corner that is farthest off takes the place of the next one, and
the face the colour along the seam. The three faces in each eye's socket are such: MakeHuman's
eyeballs are another mesh. Their common vertex takes a place of its own in their middle.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

_STEPS = 65535
_TORN = 3.0
"""Picture to metre, the largest of a face: of 99 in 100 it is at most 2.1."""


def texture_of(
    obj: str, index: NDArray, faces: NDArray, template_m: NDArray
) -> dict[str, NDArray[np.uint16]]:
    """`places` (T, 2) and `corners` (F, 3), as the asset has them.

    Parameters
    ----------
    obj : MakeHuman's `base.obj`.
    index : (V,) the body's vertices in it.
    faces, template_m : (F, 3) and (V, 3) of the body.
    """
    places, of_vertex = _read_places(obj)
    corners = np.zeros(faces.shape, int)
    for row, face in enumerate(faces):
        choices = list(product(*(sorted(of_vertex[vertex]) for vertex in index[face])))
        sides = [_sides(places[list(choice)]) for choice in choices]
        best = int(np.argmin([side.max() for side in sides]))
        corners[row] = choices[best]
        if sides[best].max() > _TORN * _sides(template_m[face]).max():
            nearest = int(sides[best].argmin())  # side 0 joins corners 0 and 1
            corners[row, (nearest + 2) % 3] = corners[row, (nearest + 1) % 3]
    used, compact = np.unique(corners, return_inverse=True)
    return with_eyes(places[used], compact.reshape(corners.shape), faces)


def with_eyes(places: NDArray, corners: NDArray, faces: NDArray) -> dict[str, NDArray[np.uint16]]:
    """The asset's arrays, with a place for each vertex whose three faces are all torn."""
    corners, places = corners.astype(np.uint16), np.round(places * _STEPS).astype(np.uint16)
    torn = (corners == np.roll(corners, 1, axis=1)).any(axis=1)
    whole_count = np.bincount(faces[~torn].ravel(), minlength=faces.max() + 1)
    count = np.bincount(faces.ravel())
    for vertex in np.flatnonzero((count == 3) & (whole_count == 0)):
        rows, columns = np.nonzero(faces == vertex)
        around = np.unique(corners[rows[:, None], (columns[:, None] + [1, 2]) % 3])
        corners[rows, columns] = len(places)
        places = np.concatenate([places, places[around].mean(axis=0, keepdims=True).round()])
    return {"places": places.astype(np.uint16), "corners": corners}


def _sides(triangle: NDArray) -> NDArray:
    """(3,) lengths."""
    return np.linalg.norm(np.roll(triangle, -1, axis=0) - triangle, axis=1)


def _read_places(obj: str) -> tuple[NDArray, dict[int, set[int]]]:
    """(T, 2) places on the picture, and those of each vertex of the body."""
    places: list[tuple[float, float]] = []
    of_vertex: dict[int, set[int]] = {}
    group = ""
    for line in obj.splitlines():
        what, *words = line.split() or [""]
        if what == "vt":
            places.append((float(words[0]), float(words[1])))
        elif what == "g":
            group = words[0]
        elif what == "f" and group == "body":
            for word in words:
                vertex, place = (int(number) - 1 for number in word.split("/")[:2])
                of_vertex.setdefault(vertex, set()).add(place)
    return np.array(places), of_vertex
