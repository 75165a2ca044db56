"""Smooth curves in time: eased keyframes, envelopes, and tracks of position and its derivatives."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BPoly

from torch_align_ae.corpus.motions.plan import Array


def ease(times_s: Array, start_s: float, stop_s: float) -> Array:
    """0 before `start_s`, 1 after `stop_s`, and twice differentiable between."""
    s = np.clip((times_s - start_s) / (stop_s - start_s), 0.0, 1.0)
    return s**3 * (10 - 15 * s + 6 * s**2)


def keyframes(times_s: Array, knots_s: ArrayLike, values: ArrayLike) -> Array:
    """Pass through `values` at `knots_s`, at rest in each, and hold the first and the last."""
    knots_s, values = np.asarray(knots_s, np.float64), np.asarray(values, np.float64)
    result = np.full(times_s.shape, values[0])
    for start_s, stop_s, change in zip(knots_s[:-1], knots_s[1:], np.diff(values), strict=True):
        result += change * ease(times_s, start_s, stop_s)
    return result


def track(times_s: Array, knots: Sequence[tuple[float, float, float, float]]) -> Array:
    """Quintic pieces through knots (time s, value, velocity, acceleration), held outside them.

    Two knots of a ballistic flight give exactly its parabola.
    """
    table = np.asarray(knots, np.float64)
    curve = BPoly.from_derivatives(table[:, 0], table[:, 1:])
    return np.asarray(curve(np.clip(times_s, table[0, 0], table[-1, 0])), np.float64)


def bump(times_s: Array, start_s: float, stop_s: float) -> Array:
    """0 outside, 1 halfway, and twice differentiable: (4 s (1 - s))^3."""
    s = np.clip((times_s - start_s) / (stop_s - start_s), 0.0, 1.0)
    return (4 * s * (1 - s)) ** 3


def cycle(times_s: Array, rate_hz: float, begin_s: float) -> Array:
    """Phase of a periodic motion that stands still until `begin_s` and speeds up over 0.3 s."""
    ramp_s = 0.3
    after_s = np.clip(times_s - begin_s, 0.0, None)
    s = np.minimum(after_s / ramp_s, 1.0)
    # The integral of a smoothstep: phase, rate and the rate's rate begin at zero.
    travelled_s = ramp_s * (s**3 - s**4 / 2) + np.maximum(after_s - ramp_s, 0.0)
    return 2 * np.pi * rate_hz * travelled_s


def axis(times_s: Array, x: ArrayLike = 0.0, y: ArrayLike = 0.0, z: ArrayLike = 0.0) -> Array:
    """(T, 3) from three curves or constants."""
    return np.stack([np.broadcast_to(part, times_s.shape) for part in (x, y, z)], axis=1)
