"""Pictures of skin on rendered bodies, and sRGB in linear light."""

from __future__ import annotations

import io
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from bridge.body import BodyModelData
from bridge.body.skin import skin_png


class Skin:
    """A picture that lies on a body.

    Parameters
    ----------
    levels : the picture in linear light, (H, W, 3) and ever coarser.
    places : (F, 3, 2) of the faces' corners, 0 to 1 from the lower left.
    texel_m : about the width of a texel on the body, metres.
    """

    def __init__(self, levels: Sequence[NDArray], places: NDArray, texel_m: float) -> None:
        self._levels, self._places, self._texel_m = levels, places.astype(np.float32), texel_m

    def at(self, faces: NDArray, shares: NDArray, pixel_m: float) -> NDArray[np.float32]:
        """Linear colours (N, 3) on faces (N,) at barycentric coordinates (N, 3).

        The picture is as coarse as pixels of the width `pixel_m` need.
        """
        level = int(np.clip(np.log2(max(pixel_m / self._texel_m, 1)), 0, len(self._levels) - 1))
        picture = self._levels[level]
        place = np.einsum("nc,ncd->nd", shares, self._places[faces])
        size = np.array(picture.shape[1::-1], np.float32)
        at = np.clip(np.array([0, 1]) + [1, -1] * place, 0, 1) * size - 0.5
        first = np.floor(at).astype(int)
        part = (at - first).astype(np.float32)
        colours = np.zeros((len(faces), 3), np.float32)
        for column in (0, 1):
            for row in (0, 1):
                x, y = np.clip(first + np.array([column, row]), 0, size.astype(int) - 1).T
                share = np.abs(1 - column - part[:, 0]) * np.abs(1 - row - part[:, 1])
                colours += share[:, None] * picture[y, x]
        return colours


def skin_of(body: BodyModelData) -> Skin | None:
    """The skin that ships with an embedded body; None for another."""
    png, texture = skin_png(body), body.texture
    if png is None or texture is None:
        return None
    levels, places = _levels_of(png), texture.places[texture.corners]
    sides = body.v_template[body.faces]
    length_m = np.linalg.norm(sides[:, 1] - sides[:, 0], axis=1).sum()
    length = np.linalg.norm(places[:, 1] - places[:, 0], axis=1).sum()
    return Skin(levels, places, float(length_m / length) / levels[0].shape[1])


@lru_cache(maxsize=2)
def _levels_of(png: bytes) -> list[NDArray[np.float32]]:
    """The picture in linear light, and ever half as large."""
    with Image.open(io.BytesIO(png)) as opened:
        picture = np.asarray(opened.convert("RGB"))
    levels = [srgb_to_linear(np.arange(256) / 255).astype(np.float32)[picture]]
    while min(levels[-1].shape[:2]) > 1:
        rows, columns = (size // 2 for size in levels[-1].shape[:2])
        fours = levels[-1][: 2 * rows, : 2 * columns].reshape(rows, 2, columns, 2, 3)
        levels.append(fours.mean(axis=(1, 3)))
    return levels


def srgb_to_linear(colour: ArrayLike) -> NDArray[np.float64]:
    """Convert sRGB values in [0, 1] to linear light."""
    srgb = np.clip(np.asarray(colour, dtype=np.float64), 0.0, 1.0)
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(light: ArrayLike) -> NDArray[np.float64]:
    """The inverse of `srgb_to_linear`; light beyond [0, 1] is clipped."""
    linear = np.clip(np.asarray(light, dtype=np.float64), 0.0, 1.0)
    return np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055)
