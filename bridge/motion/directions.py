"""Directions (..., 3), and the shortest turns between them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def unit(vectors: NDArray) -> NDArray[np.float64]:
    """(..., 3) of length 1; what has no length stays so."""
    vectors = np.asarray(vectors, np.float64)
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-30)


def angle_deg(one: NDArray, other: NDArray) -> NDArray[np.float64]:
    """(...) between directions (..., 3)."""
    return np.degrees(np.arccos(np.clip((unit(one) * unit(other)).sum(axis=-1), -1, 1)))


def shortest_turn(start: NDArray, end: NDArray) -> NDArray[np.float64]:
    """(..., 3, 3) rotations of directions (..., 3) into others; 1 where these are opposite."""
    start, end = unit(start), unit(end)
    axis, cosine = np.cross(start, end), (start * end).sum(axis=-1)[..., None, None]
    x, y, z = np.moveaxis(axis, -1, 0)
    none = np.zeros_like(x)
    cross = np.stack([none, -z, y, z, none, -x, -y, x, none], axis=-1).reshape(*axis.shape, 3)
    return np.eye(3) + cross + cross @ cross / np.maximum(1 + cosine, 1e-12)
