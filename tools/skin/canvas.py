"""A picture on a body: each texel knows where it lies on the body at rest, and is painted by that.

Borders are given as distances in metres, so that they are smooth at any size of the picture.
"""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import distance_transform_edt

from bridge.body import BodyModelData

PADDING_PX = 8
"""Texels around each island that take the colour of its border."""
_SOFT_M = 0.0012
"""Half the width of a border, metres."""
_INSIDE = -1e-3
"""Barycentric coordinates above this are within a face."""


class Canvas:
    """Texels of a square picture of `size` pixels that lie on the body.

    Attributes
    ----------
    x_m, y_m, z_m : (N,) places of the texels at rest, metres; y up, z forward.
    colours : (N, 3) sRGB, 0 to 1.
    """

    def __init__(self, body: BodyModelData, size: int) -> None:
        assert body.texture is not None
        self.size, self.body = size, body
        corners = body.texture.corners
        places = body.texture.places * [size, -size] + [0, size]
        self._face = np.full((size, size), -1)
        self._shares = np.zeros((size, size, 3), np.float32)
        for number, triangle in enumerate(places[corners]):
            self._fill(number, triangle)
        self._covered = np.nonzero(self._face >= 0)
        self.x_m, self.y_m, self.z_m = self.on_texels(body.v_template).T
        self.colours = np.zeros((len(self.x_m), 3))

    def _fill(self, number: int, triangle: NDArray) -> None:
        """Find the texels whose middles are in a face (3, 2), rows down."""
        first = np.maximum(np.floor(triangle.min(axis=0) - 0.5).astype(int), 0)
        last = np.minimum(np.ceil(triangle.max(axis=0) + 0.5).astype(int), self.size)
        sides = (triangle[1:] - triangle[0]).T
        if abs(np.linalg.det(sides)) < 1e-6:  # torn, see `tools/embedded_body/texture.py`
            return
        x, y = np.meshgrid(np.arange(first[0], last[0]), np.arange(first[1], last[1]))
        middles = np.stack([x, y], axis=-1) + 0.5 - triangle[0]
        two = middles @ np.linalg.inv(sides).T
        shares = np.concatenate([1 - two.sum(axis=-1, keepdims=True), two], axis=-1)
        inside = (shares > _INSIDE).all(axis=-1)
        self._face[y[inside], x[inside]] = number
        self._shares[y[inside], x[inside]] = shares[inside]

    def on_texels(self, values: NDArray) -> NDArray:
        """Values (V, ...) of vertices, interpolated to (N, ...)."""
        corners = self.body.faces[self._face[self._covered]]
        return np.einsum("nc,nc...->n...", self._shares[self._covered], values[corners])

    def paint(self, colour: ArrayLike, amount: NDArray) -> None:
        """Lay a colour over the texels by amounts (N,) from 0 to 1."""
        self.colours += amount[:, None] * (np.asarray(colour) - self.colours)

    def darken(self, factor: NDArray) -> None:
        """Multiply the colours by factors (N,)."""
        self.colours *= factor[:, None]

    def picture(self, background: ArrayLike) -> NDArray[np.uint8]:
        """(size, size, 3) with each island's colours spread a little over its border."""
        picture = np.full((self.size, self.size, 3), background, float)
        picture[self._covered] = self.colours
        away_px, nearest = cast(
            tuple[NDArray, NDArray], distance_transform_edt(self._face < 0, return_indices=True)
        )
        near = away_px <= PADDING_PX
        picture[near] = picture[tuple(nearest)][near]
        return np.round(255 * picture.clip(0, 1)).astype(np.uint8)


def within(distance_m: NDArray, soft_m: float = _SOFT_M) -> NDArray:
    """How much lies within a border, 0 to 1, by signed distances in metres, negative inside."""
    part = np.clip(0.5 - distance_m / (2 * soft_m), 0, 1)
    return part * part * (3 - 2 * part)


def ellipse_m(x: NDArray, y: NDArray, half_x: ArrayLike, half_y: ArrayLike) -> NDArray:
    """About the signed distance (N,) to an ellipse around the origin."""
    size = np.hypot(x / half_x, y / half_y)
    slope = np.hypot(x / np.square(half_x), y / np.square(half_y))
    return size * (size - 1) / np.maximum(slope, 1e-9)
