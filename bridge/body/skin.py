"""The pictures of skin that ship with the embedded bodies, and how they lie on a mesh.

`assets/embedded_skin_{female,male}.png`, painted by `tools/paint_skin.py`: skin, eyes, short hair
and plain sportswear, on the texture coordinates of `assets/embedded_texture.npz`.
"""

from __future__ import annotations

from importlib import resources
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.body.embedded import EMBEDDED_GENDERS, embedded_texture
from bridge.body.model_data import BodyModelData, Texture

ROUGHNESS = 0.75
"""Of the skin in exported materials; it is no metal."""


def skin_png(body: BodyModelData) -> bytes | None:
    """The picture of an embedded body's skin as a PNG file; None for any other body.

    A copy of an embedded body in a file of its own has it too.
    """
    if body.source != "synthetic" or body.texture is None or body.gender not in EMBEDDED_GENDERS:
        return None
    if not np.array_equal(body.texture.corners, embedded_texture().corners):
        return None
    asset = resources.files("bridge.body") / "assets" / f"embedded_skin_{body.gender}.png"
    return asset.read_bytes()


class SplitMesh(NamedTuple):
    """A mesh with one place on the picture for each of its W vertices, as most tools want it.

    The first V vertices are the body's own; copies of those at seams follow.
    """

    vertex: NDArray[np.int64]
    """(W,) the body's vertex that each of them is."""
    places: NDArray[np.float64]
    """(W, 2) on the picture, 0 to 1 from its lower left corner."""
    faces: NDArray[np.int64]
    """(F, 3) of them."""


def split_at_seams(faces: NDArray, texture: Texture) -> SplitMesh:
    """Copy the vertices of faces (F, 3) that have several places, once for each place."""
    corners = np.stack([faces.ravel(), texture.corners.ravel()], axis=1)
    pairs, of_corner = np.unique(corners, axis=0, return_inverse=True)
    vertex, place = pairs.T
    first = np.concatenate([[True], np.diff(vertex) > 0])  # sorted by vertex
    order = np.concatenate([np.flatnonzero(first), np.flatnonzero(~first)])
    if not np.array_equal(vertex[order][: first.sum()], np.arange(faces.max() + 1)):
        raise ValueError("a vertex without a face has no place on the picture")
    number = np.empty(len(pairs), np.int64)
    number[order] = np.arange(len(pairs))
    return SplitMesh(
        vertex[order],
        texture.places[place[order]],
        number[of_corner.ravel()].reshape(faces.shape),
    )
