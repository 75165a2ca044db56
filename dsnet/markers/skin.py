"""What real skin markers say of predicted skin: motion of each in its segment's frame.

The posed body answers at each marker's vertex, once without offsets and once with them; both give
segment frames by the same markers, so that what a frame of markers on flesh gets wrong it gets
wrong in both. Two comparisons, each by R2 = 1 - error / motion:

    flesh   real motion less the pose's own part, against what offsets add: 1 for true offsets, 0
            for none
    total   posed skin with offsets against the marker, in the real markers' frame; beside it what
            the pose alone gives there: where that is near 1 on a soft spot, the pose was fitted to
            flesh, and right offsets count its bounce twice
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field

import numpy as np
from numpy.typing import NDArray

from bridge.body.model_data import SMPL_JOINT_NAMES, BodyModelData
from bridge.errors import DsnetError
from bridge.motion import Motion
from dsnet.markers.registration import SPOTS, Registered, Spot
from dsnet.markers.segments import (
    CUT_HZ,
    SEGMENTS,
    Cloud,
    Frame,
    Pose,
    bridged,
    faster,
    rigid_motion,
    segment_frames,
)

BANDS_HZ = ((0, 2), (2, 4), (4, 6), (6, 9), (9, 15))
_LONG_GAP_S, _EDGE_S, _LAG_S = 0.12, 0.1, 0.2
"""A longer gap's bridge bends what the filter gives beside it; so do the motion's ends."""


@dataclass(frozen=True)
class Size:
    """How large a motion is; x to the left, y up, z to the front."""

    rms_mm: list[float]
    peak_to_peak_mm: list[float]
    energy: list[float]
    """Its part in each of `BANDS_HZ`."""


@dataclass(frozen=True)
class Row:
    """One marker."""

    label: str
    region: str
    segment: str
    doubt: str
    vertex: int
    seen: float
    """Part of the frames that are scored."""
    real: Size
    predicted: Size
    flesh_r2: float
    flesh_r2_up: float
    """Of the vertical alone, as all that ends in `up`."""
    total_r2_up: float
    pose_r2_up: float
    """Total of the pose alone."""
    total_peak_to_peak_up_mm: float
    pose_peak_to_peak_up_mm: float
    lag_ms: float
    """By how much the prediction comes too early."""


@dataclass(frozen=True, eq=False)
class Curves:
    """(T,) vertical motion of one marker, millimetres, for a figure."""

    real: NDArray
    total: NDArray
    pose: NDArray
    good: NDArray


@dataclass(frozen=True, eq=False)
class Comparison:
    """All rows of one motion."""

    rows: list[Row]
    floor_mm: dict[str, list[float]]
    """rms in x, y, z of a marker on bone in the frame of the others: what the method cannot see."""
    curves: dict[str, Curves] = field(default_factory=dict)

    def summary(self) -> dict:
        """What goes into a JSON file: no curves."""
        return {
            "above_hz": CUT_HZ,
            "bands_hz": BANDS_HZ,
            "rows": [asdict(row) for row in self.rows],
            "floor_rms_mm": self.floor_mm,
        }


def compare_offsets(
    body: BodyModelData, motion: Motion, offsets_m: NDArray, registered: Registered
) -> Comparison:
    """Compare a prediction with the markers of the same motion.

    `DsnetError` if there is no region that can be compared.

    Parameters
    ----------
    offsets_m : (T, V, 3) predicted, in the rest pose.
    """
    real, pose, fps = registered.cloud, Pose.of(body, motion), motion.fps
    bare, full = (registered.posed(body, motion, one) for one in (None, offsets_m))
    real_frames = segment_frames(real, pose)
    bare_frames, full_frames = (segment_frames(one, pose, real_frames) for one in (bare, full))
    inner = np.zeros(len(motion.theta), bool)
    edge = int(_EDGE_S * fps)
    inner[edge : len(inner) - edge] = True
    rows, curves = [], {}
    for label, spot, moved_mm, good in at_spots(real, real_frames, fps):
        frame, at_rest, swung = (f[spot.segment] for f in (real_frames, bare_frames, full_frames))
        rest = at_rest.local_mm(bare.points_m[label])
        moved, added, posed, pose_there, total_there = (
            faster(series_mm, fps)
            for series_mm in (
                moved_mm,
                swung.local_mm(full.points_m[label]) - rest,
                rest,
                frame.local_mm(bare.points_m[label]),
                frame.local_mm(full.points_m[label]),
            )
        )
        flesh = (moved - posed)[good], added[good]
        total, alone = total_there[good, 1], pose_there[good, 1]
        rows.append(
            Row(
                label=label,
                region=spot.region,
                segment=spot.segment,
                doubt=SEGMENTS[spot.segment].doubt,
                vertex=registered.vertices[label],
                seen=round(float(good.sum() / inner.sum()), 3),
                real=size_of(moved, good, fps),
                predicted=size_of(added, good, fps),
                flesh_r2=_r2(*flesh),
                flesh_r2_up=_r2(flesh[0][:, 1], flesh[1][:, 1]),
                total_r2_up=_r2(moved[good, 1], total),
                pose_r2_up=_r2(moved[good, 1], alone),
                total_peak_to_peak_up_mm=_round(np.ptp(total)),
                pose_peak_to_peak_up_mm=_round(np.ptp(alone)),
                lag_ms=_lag_ms(moved[:, 1], added[:, 1], good, fps),
            )
        )
        curves[label] = Curves(moved[:, 1], total_there[:, 1], pose_there[:, 1], good)
    if not rows:
        raise DsnetError(
            f"markers {', '.join(sorted(registered.vertices)[:6])}, ... of {motion.source}",
            "some on soft places (LBUST, MBLLY, LBUM, LTHI, ...) and three on the bone of their "
            "segment (CLAV, C7, T8, LBAK, RBAK for the chest)",
            "Name them as AMASS does, or pass another file.",
        )
    return Comparison(rows, floor_mm(real, pose, real_frames, inner, fps), curves)


def at_spots(
    cloud: Cloud, frames: Mapping[str, Frame], fps: float
) -> Iterator[tuple[str, Spot, NDArray[np.float64], NDArray[np.bool_]]]:
    """Label, place, motion (T, 3) in its segment's frame, millimetres, and frames (T,) that count
    of each marker of `SPOTS` that was seen for a second."""
    for label, spot in SPOTS.items():
        if label not in cloud.points_m or spot.segment not in frames:
            continue
        frame = frames[spot.segment]
        ok = cloud.seen[label] & frame.good
        good = _scored(ok, fps)
        if good.sum() >= fps:
            yield label, spot, bridged(frame.local_mm(cloud.points_m[label]), ok), good


def floor_mm(
    real: Cloud, pose: Pose, frames: Mapping[str, Frame], inner: NDArray, fps: float
) -> dict[str, list[float]]:
    """Of each marker of a rigid segment in the frame of its other markers: rms, millimetres."""
    floor = {}
    for name in (name for name, frame in frames.items() if frame.weights is not None):
        labels = [label for label in SEGMENTS[name].labels if label in real.points_m]
        for label in labels if len(labels) > 3 else ():
            others = [other for other in labels if other != label]
            turns, places, _ = rigid_motion(
                np.stack([real.points_m[other] for other in others], axis=1),
                np.stack([real.seen[other] for other in others], axis=1),
            )
            good = inner & real.seen[label]
            inside = Frame(turns, places, good).local_mm(real.points_m[label])
            # The frame of the others has its own axes: the rest pose's, on average.
            bone = pose.turns[:, SMPL_JOINT_NAMES.index(SEGMENTS[name].bone)]
            inside = inside @ np.einsum("tyx,tyz->xz", turns, bone) / len(turns)
            moved = faster(bridged(inside, real.seen[label]), fps)[good]
            floor[f"{name}: {label}"] = [_round(value) for value in moved.std(axis=0)]
    return floor


def _scored(seen: NDArray[np.bool_], fps: float) -> NDArray[np.bool_]:
    """Frames that count: seen, and beside neither a long gap nor an end."""
    out, margin = seen.copy(), int(_EDGE_S * fps)
    out[:margin] = out[len(out) - margin :] = False
    for first, end in np.flatnonzero(np.diff(np.r_[1, seen, 1])).reshape(-1, 2):
        if end - first > _LONG_GAP_S * fps:
            out[max(0, first - margin) : end + margin] = False
    return out


def _r2(real: NDArray, predicted: NDArray) -> float:
    motion = (real**2).sum()
    return round(float(1 - ((real - predicted) ** 2).sum() / motion), 4) if motion > 1e-9 else 0.0


def size_of(series: NDArray, good: NDArray, fps: float) -> Size:
    """Of a motion (T, 3), millimetres, in the frames (T,) that count."""
    # Commands that can use markers import this module: SciPy's filters load slowly.
    from scipy.signal import periodogram

    frequency, power = periodogram(np.where(good[:, None], series, 0), fps, axis=0)
    total = max(power.sum(), 1e-12)
    part = [
        float(power[(frequency >= low) & (frequency < high)].sum() / total)
        for low, high in BANDS_HZ
    ]
    return Size(
        [_round(value) for value in series[good].std(axis=0)],
        [_round(value) for value in np.ptp(series[good], axis=0)],
        [round(value, 3) for value in part],
    )


def _lag_ms(real: NDArray, predicted: NDArray, good: NDArray, fps: float) -> float:
    """The shift by which the prediction fits best, positive where it comes too early."""
    most = int(_LAG_S * fps)
    inner = slice(most, len(real) - most)
    fits = []
    for shift in range(-most, most + 1):
        both = (good & np.roll(good, shift))[inner]
        one, two = real[inner][both], np.roll(predicted, shift)[inner][both]
        size = np.sqrt((one**2).sum() * (two**2).sum())
        fits.append((one * two).sum() / size if size > 1e-9 else 0.0)
    return round(1e3 * (int(np.argmax(fits)) - most) / fps, 1)


def _round(value: float) -> float:
    return round(float(value), 2)
