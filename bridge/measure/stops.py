"""When a body stands still: only then can flesh be seen to swing out and come to rest.

The swing in a frame is the mean over vertices of |offset - settled offset|, where the settled
offset of a vertex is its mean over the last frames of standing still: gravity leaves flesh hanging,
and what hangs does not swing. Rest is what is left in those frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.body import BodyModelData
from bridge.body.posing import posed_joints
from bridge.measure.metrics import Offsets, Sums
from bridge.motion import unpack_theta

STILL_BELOW_M_S = 0.1
"""Mean speed of the joints; who stands at ease sways by less."""
_MOVED_ABOVE_M_S = 0.3
_MOVED_WITHIN_S = 0.5
_LEAST_S = 0.6
_LAST_S = 0.2
_FALLEN = 0.2
# A mean over all vertices, most of which lie on bone: less than this is no swing.
_LEAST_SWING_M = 5e-5


@dataclass(frozen=True)
class StillSpan:
    """Frames through which a body stands still; the last are settled: one swing of soft flesh."""

    frames: slice
    settled: slice
    after_motion: bool
    """Whether the body moved just before."""


def joint_speed_m_s(
    body: BodyModelData, betas: ArrayLike, theta: ArrayLike, fps: float
) -> NDArray[np.float64]:
    """(T,) speed from frame to frame, mean over the joints, of a shape (10,) in motion (T, 69).

    The first frame has the second's.
    """
    pose, trans = unpack_theta(np.asarray(theta, dtype=np.float64))
    _, places = posed_joints(body, np.asarray(betas, dtype=np.float64), pose, trans)
    speed = np.linalg.norm(np.diff(places, axis=0), axis=-1).mean(axis=1) * fps
    return np.concatenate([speed[:1], speed]) if len(speed) else np.zeros(len(pose))


def still_spans(speed_m_s: ArrayLike, fps: float) -> list[StillSpan]:
    """Stretches of 0.6 s and more in which the body stands still, in order."""
    speed = np.asarray(speed_m_s)
    still = np.concatenate([[False], speed < STILL_BELOW_M_S, [False]])
    edges = np.flatnonzero(np.diff(still))
    last, spans = max(1, round(_LAST_S * fps)), []
    for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if stop - start >= _LEAST_S * fps:
            before = speed[max(0, start - round(_MOVED_WITHIN_S * fps)) : start]
            moved = bool((before > _MOVED_ABOVE_M_S).any())
            spans.append(StillSpan(slice(start, stop), slice(stop - last, stop), moved))
    return spans


def swing_sums_m(offsets: Offsets, spans: Sequence[StillSpan]) -> NDArray[np.float64]:
    """(T,) swing of some vertices after each stop, summed over them, metres; else 0."""
    sums_m = np.zeros(len(offsets.moving_m))
    for span in spans:
        if span.after_motion:
            settled_m = offsets.moving_m[span.settled].mean(axis=0)
            swing_m = np.linalg.norm(offsets.moving_m[span.frames] - settled_m, axis=-1)
            sums_m[span.frames] = swing_m.sum(axis=1)
    return sums_m


def fall_time_s(swing_m: ArrayLike, fps: float) -> float:
    """From the first frame until a curve (T,) stays below a fifth of its largest value.

    The last time above counts, so that the zeros of a swing are not taken for its end.
    """
    swing = np.asarray(swing_m)
    above = np.flatnonzero(swing >= _FALLEN * swing.max())
    return float(above[-1] + 1) / fps if swing.max() > 0 else 0.0


@dataclass
class Decays(Sums):
    """How fast the swing of flesh dies away after each stop, predicted and true.

    `true_s`, `predicted_s`: until it stays below a fifth of its largest, `true_mm`, `predicted_mm`.
    """

    stops: list[dict[str, float]] = field(default_factory=list)

    @classmethod
    def of(
        cls, predicted_m: NDArray, true_m: NDArray, spans: Sequence[StillSpan], fps: float
    ) -> Decays:
        """Every stop of one sequence after which the true flesh swings, from swings (T,)."""
        found = cls()
        for span in spans:
            swings = {"true": true_m[span.frames], "predicted": predicted_m[span.frames]}
            if span.after_motion and swings["true"].max() >= _LEAST_SWING_M:
                times = {f"{key}_s": fall_time_s(one, fps) for key, one in swings.items()}
                sizes = {f"{key}_mm": 1e3 * float(one.max()) for key, one in swings.items()}
                found.stops.append(times | sizes)
        return found

    def summary(self) -> dict[str, Any] | None:
        """Means over stops and how many there are; None without any."""
        if not self.stops:
            return None
        off_s = float(np.mean([abs(one["predicted_s"] - one["true_s"]) for one in self.stops]))
        means = {key: float(np.mean([one[key] for one in self.stops])) for key in self.stops[0]}
        return {"stops": len(self.stops), "off_s": off_s} | means


@dataclass
class RestSums(Sums):
    """Sizes over the settled frames of still spans: what a body that has stood still is given."""

    metres: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    """Sums of |predicted|, |true| and |predicted - true|."""
    count: int = 0
    """Vertices, over all settled frames."""

    @classmethod
    def of(cls, predicted: Offsets, true: Offsets, spans: Sequence[StillSpan]) -> RestSums:
        sums = cls()
        for span in spans:
            found_m, real_m = predicted.moving_m[span.settled], true.moving_m[span.settled]
            sizes_m = (np.linalg.norm(m, axis=-1) for m in (found_m, real_m, found_m - real_m))
            sums.metres += [size_m.sum(dtype=np.float64) for size_m in sizes_m]
            sums.count += real_m.shape[0] * real_m.shape[1]
        return sums

    def summary(self) -> dict[str, float] | None:
        """Mean sizes and mean error, millimetres; None if the body never stands still."""
        if not self.count:
            return None
        names = ("predicted_mm", "true_mm", "error_mm")
        return dict(zip(names, (1e3 * self.metres / self.count).tolist(), strict=True))
