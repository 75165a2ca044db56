"""Vertices of consecutive frames as few bits as a stated error allows.

Each coordinate becomes a whole number of steps, so that what is decoded differs by at most the
bound, everywhere. Of these whole numbers the differences in time are small: their first or second
difference, whichever is smaller, goes into byte planes, which deflate well.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.errors import DsnetError

MOST_PLANES = 4
MOST_DIFFERENCES = 2
# Half of a float32's last bit, twice: what rounding to float32 adds, and room to spare.
_ROUNDING = 2.0**-23
_LEAST_BOUND = 1e-15
"""Far above the smallest float32, below which rounding is not relative."""
_SAMPLED = 7
_MOST = float(np.finfo(np.float32).max)


def least_bound(largest: float) -> float:
    """The smallest bound for values of at most this size: a float32 holds little less."""
    return max(4 * _ROUNDING * largest, _LEAST_BOUND)


def step_for(bound: float, largest: float, unit: str = "") -> float:
    """Width of a step with which every value of at most `largest` is decoded within `bound`.

    Raises
    ------
    DsnetError
        If the bound is none, or smaller than `least_bound`, or the values are no float32.
    """
    if not 0 < bound < np.inf:
        raise DsnetError(f"a bound of {bound:g}", "a finite bound above 0", "Pass another bound.")
    if not largest + bound < _MOST:
        raise DsnetError(
            f"values of up to {largest:g}", f"finite numbers below {_MOST:g}", "Check the data."
        )
    if bound < least_bound(largest):
        raise DsnetError(
            f"a bound of {bound:g} {unit} for values of up to {largest:g} {unit}",
            f"{least_bound(largest):.2g} {unit} or more: float32 has no more digits",
            "Pass a larger bound.",
        )
    # Relative to the largest value that may be decoded.
    return 2 * (bound - _ROUNDING * (largest + bound))


@dataclass(frozen=True, eq=False)
class CodedFrames:
    """Some frames as byte planes."""

    planes: NDArray[np.uint8]
    """(P, n * V * 3) of P bytes a number, the lowest first; frame, then coordinate, then vertex."""
    differences: int
    """How often the difference in time was taken."""


def encode(frames: ArrayLike, step: float, differences: tuple[int, ...] = (1, 2)) -> CodedFrames:
    """Frames (n, V, 3), finite, of at most 2^28 steps, in whole steps.

    Parameters
    ----------
    differences : how often the difference in time may be taken; what makes them smallest is.
    """
    values = np.asarray(frames, np.float64).transpose(0, 2, 1)
    taken = [np.rint(values / step).astype(np.int64)]
    for _ in range(max(differences)):
        taken.append(np.diff(taken[-1], axis=0, prepend=0))
    times = min(differences, key=lambda count: _bits(taken[count]))
    return CodedFrames(_planes(taken[times]), times)


def decode(coded: CodedFrames, step: float, shape: tuple[int, int, int]) -> NDArray[np.float32]:
    """The frames (n, V, 3) again, at most the bound of `step` from what was given.

    Raises
    ------
    ValueError
        If these are no such planes, or hold what float32 does not.
    """
    n, vertices, sides = shape
    count, size = coded.planes.shape
    in_order = 1 <= count <= MOST_PLANES and 0 <= coded.differences <= MOST_DIFFERENCES
    if not in_order or size != n * vertices * sides:
        raise ValueError(f"{count} planes of {size} bytes, of differences {coded.differences}")
    whole = _from_planes(coded.planes).reshape(n, sides, vertices)
    for _ in range(coded.differences):
        whole = np.cumsum(whole, axis=0)
    with np.errstate(over="ignore"):
        values = (whole * step).astype(np.float32)
    if not np.isfinite(values).all():
        raise ValueError("numbers that are not finite")
    return np.ascontiguousarray(values.transpose(0, 2, 1))


def _bits(whole: NDArray[np.int64]) -> float:
    """About how many bits these numbers take, going by some of them."""
    return float(np.log2(1.0 + np.abs(whole.reshape(-1)[::_SAMPLED])).sum())


def _planes(whole: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Signs go to the lowest bit, so that small numbers have empty high bytes."""
    folded = ((whole << 1) ^ (whole >> 63)).astype("<u4").reshape(-1)
    bytes_of_each = folded.view(np.uint8).reshape(-1, MOST_PLANES)
    used = max(1, (int(folded.max(initial=0)).bit_length() + 7) // 8)
    return np.ascontiguousarray(bytes_of_each[:, :used].T)


def _from_planes(planes: NDArray[np.uint8]) -> NDArray[np.int64]:
    bytes_of_each = np.zeros((planes.shape[1], MOST_PLANES), np.uint8)
    bytes_of_each[:, : len(planes)] = planes.T
    folded = bytes_of_each.reshape(-1).view("<u4").astype(np.int64)
    return (folded >> 1) ^ -(folded & 1)
