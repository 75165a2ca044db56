"""One round of a motion that repeats itself, for a clip that loops without a jump."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bridge.motion import unpack_theta
from bridge.paper import FPS

LEAST_S = 0.7
_STEP_WEIGHT, _PLACE_WEIGHT = 5.0, 3.0
"""Steps from frame to frame, and metres beside radians, that differ by so much less are seen as
easily."""


def closed_lap(theta: NDArray, multiple: int) -> NDArray[np.float64]:
    """(T', 69) a round of a motion (T, 69) whose last frame leads into its first.

    What is left between its two ends, some degrees, is spread evenly over it.

    Parameters
    ----------
    multiple : T' is one of it: the frames from one picture of the clip to the next.
    """
    return closed(np.asarray(theta, np.float64), best_lap(theta, multiple))


def closed(values: NDArray, lap: slice) -> NDArray:
    """Those of a round (T', ...), what is left between its two ends spread evenly over it."""
    done = np.linspace(0.0, 1.0, lap.stop - lap.start, endpoint=False)
    spread = np.multiply.outer(done, values[lap.start] - values[lap.stop])
    return values[lap] + spread.astype(values.dtype)


def best_lap(theta: NDArray, multiple: int) -> slice:
    """The frames of a motion after which it goes on most nearly as it did before them."""
    pose, trans_m = unpack_theta(np.asarray(theta, np.float64))
    places = np.concatenate([pose.reshape(len(pose), -1), _PLACE_WEIGHT * trans_m], axis=1)
    steps = _STEP_WEIGHT * np.diff(places, axis=0)
    seen = np.concatenate([places[:-1], steps], axis=1)
    least = -(-int(LEAST_S * FPS) // multiple) * multiple
    lengths = range(least, len(seen) - 1, multiple)
    gaps = {count: np.abs(seen[count:] - seen[:-count]).max(axis=1) for count in lengths}
    count = min(gaps, key=lambda one: gaps[one].min())
    start = int(gaps[count].argmin())
    return slice(start, start + count)
