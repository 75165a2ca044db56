"""Directions (..., 3), angles and shortest turns between them, and middles of two sides."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation


def unit(vectors: NDArray) -> NDArray[np.float64]:
    """(..., 3) of length 1; what has no length stays so."""
    vectors = np.asarray(vectors, np.float64)
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-30)


def angle_deg(one: NDArray, other: NDArray) -> NDArray[np.float64]:
    """(...) between directions (..., 3)."""
    return np.degrees(np.arccos(np.clip((unit(one) * unit(other)).sum(axis=-1), -1, 1)))


def turn_deg(one: NDArray, other: NDArray) -> float:
    """Median angle between rotations (..., 3, 3)."""
    apart = Rotation.from_matrix(np.swapaxes(one, -1, -2) @ other)
    return float(np.degrees(np.median(apart.magnitude())))


def middle(places: Mapping[str, NDArray], name: str) -> NDArray[np.float64]:
    """(..., 3) between the left and the right one."""
    return 0.5 * (places[f"left_{name}"] + places[f"right_{name}"])


def shortest_turn(start: NDArray, end: NDArray) -> NDArray[np.float64]:
    """(..., 3, 3) rotations of directions (..., 3) into others; 1 where these are opposite."""
    start, end = unit(start), unit(end)
    axis, cosine = np.cross(start, end), (start * end).sum(axis=-1)[..., None, None]
    x, y, z = np.moveaxis(axis, -1, 0)
    none = np.zeros_like(x)
    cross = np.stack([none, -z, y, z, none, -x, -y, x, none], axis=-1).reshape(*axis.shape, 3)
    return np.eye(3) + cross + cross @ cross / np.maximum(1 + cosine, 1e-12)
