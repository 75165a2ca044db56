"""Frames of body segments from markers on bone, which separate what flesh does from what the
skeleton does.

A marker's motion is its place in its segment's frame, whose axes are those of the rest pose (x to
the left, y up, z to the front). Rigid segments are fitted to three markers or more (Kabsch); a limb
has two points, its long axis is theirs and its twist the pose's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.body.model_data import SMPL_JOINT_NAMES, BodyModelData
from bridge.body.posing import posed_joints
from bridge.motion import Motion, unpack_theta
from bridge.motion.directions import shortest_turn, unit

CUT_HZ = 1.2
"""Slower motion is the pose's and the frame's drift, not flesh."""
SEEN_ENOUGH = 0.6
"""Part of the frames in which a marker must be seen to be used."""
_STILL_M = 0.003
"""A marker that moves by this much against the others counts half."""
_ROUNDS = 12
"""Fits of the rigid shape: after four they change by less than a hundredth of a millimetre."""

SIDES = {"L": "left", "R": "right"}

_ON_FLESH = "indicative: the pelvis' own markers ride on flesh"
_TWIST = "twist from the pose"
_HIP_END = f"indicative: its upper end is carried by the pelvis' markers, {_TWIST}"
_SLIDES = f"indicative: the skin of the shoulder slides, {_TWIST}"


@dataclass(frozen=True)
class Segment:
    """A part of the body that is taken for rigid."""

    bone: str
    """Joint of SMPL that turns it."""
    labels: tuple[str, ...]
    """Its markers; two make a limb, `hip` is the pose's hip joint, carried by the pelvis."""
    doubt: str = ""
    """Why its rows are not evidence, or what is taken from the pose."""


def _of_sides(name: str, bone: str, labels: str, doubt: str) -> dict[str, Segment]:
    """The same segment left and right; `*` stands for the side's letter."""
    return {
        name.replace("*", side): Segment(
            f"{word}_{bone}", tuple(labels.replace("*", side).split()), doubt
        )
        for side, word in SIDES.items()
    }


SEGMENTS: dict[str, Segment] = {
    "head": Segment("head", ("LFHD", "RFHD", "LBHD", "RBHD", "ARIEL")),
    "thorax": Segment("spine3", ("CLAV", "C7", "T8", "T10", "LBAK", "RBAK")),
    "pelvis": Segment(
        "pelvis",
        ("LPSI", "RPSI", "SACR", "LASI", "RASI", "LBWT", "RBWT", "LFWT", "RFWT"),
        _ON_FLESH,
    ),
    **_of_sides("*thigh", "hip", "hip *KNE", _HIP_END),
    **_of_sides("*calf", "knee", "*KNE *ANK", _TWIST),
    **_of_sides("*arm", "shoulder", "*SHO *ELB", _SLIDES),
}


@dataclass(frozen=True, eq=False)
class Cloud:
    """Labelled points over T frames."""

    points_m: Mapping[str, NDArray[np.float64]]
    """(T, 3) of each label; bridged where it was not seen."""
    seen: Mapping[str, NDArray[np.bool_]]
    """(T,) of each label."""


@dataclass(frozen=True, eq=False)
class Pose:
    """The bones of a body in the pose that was fitted to the markers."""

    bones: NDArray[np.float64]
    """(T, 24, 4, 4) of each joint of SMPL, from the rest pose to the world."""
    joints_m: NDArray[np.float64]
    """(T, 24, 3)."""

    @classmethod
    def of(cls, body: BodyModelData, motion: Motion) -> Pose:
        return cls(*posed_joints(body, motion.betas, *unpack_theta(motion.theta)))

    @property
    def turns(self) -> NDArray[np.float64]:
        """(T, 24, 3, 3)."""
        return self.bones[..., :3, :3]


@dataclass(frozen=True, eq=False)
class Frame:
    """A segment's frame."""

    turns: NDArray[np.float64]
    """(T, 3, 3) from its axes to the world's."""
    places_m: NDArray[np.float64]
    """(T, 3) of its origin."""
    good: NDArray[np.bool_]
    """(T,) whether enough markers were seen."""
    weights: NDArray[np.float64] | None = None
    """(N,) of a rigid segment's markers: still ones weigh more."""

    def local_mm(self, points_m: NDArray) -> NDArray[np.float64]:
        """(T, 3) points in this frame, millimetres."""
        return 1e3 * np.einsum("tyx,ty->tx", self.turns, points_m - self.places_m)


def segment_frames(
    cloud: Cloud, pose: Pose, like: Mapping[str, Frame] | None = None
) -> dict[str, Frame]:
    """The frames that a cloud's markers allow.

    Parameters
    ----------
    like : frames of other markers under the same labels, whose weights are taken, so that both
        have the same faults.
    """
    frames: dict[str, Frame] = {}
    for name, segment in SEGMENTS.items():
        labels = [
            label
            for label in segment.labels
            if label in cloud.points_m and cloud.seen[label].mean() > SEEN_ENOUGH
        ]
        joint = SMPL_JOINT_NAMES.index(segment.bone)
        bone = pose.turns[:, joint]
        if len(segment.labels) > 2:
            if len(labels) > 2:
                weights = None if like is None else like[name].weights
                frames[name] = _rigid_frame(cloud, labels, bone, weights)
            continue
        ends = [cloud.points_m[label] for label in labels]
        good = np.logical_and.reduce([cloud.seen[label] for label in labels])
        if "hip" in segment.labels and labels and (pelvis := frames.get("pelvis")):
            ends = [_carried(pelvis, pose.joints_m[:, joint]), *ends]
            good = pelvis.good & good
        if len(ends) == 2 and good.any():
            frames[name] = _limb_frame(ends[0], ends[1], bone, good)
    return frames


def bridged(points: NDArray, seen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(T, 3) points, with smooth bridges over the frames in which they were not seen."""
    out = np.array(points, np.float64)
    if seen.all() or seen.sum() < 2:
        return out
    frames = np.arange(len(out))
    from scipy.interpolate import PchipInterpolator

    curve = PchipInterpolator(frames[seen], out[seen])
    out[~seen] = curve(np.clip(frames[~seen], frames[seen][0], frames[seen][-1]))
    return out


def faster(series: NDArray, fps: float) -> NDArray[np.float64]:
    """(T, 3) what is faster than `CUT_HZ`, without delay."""
    # Every prediction imports this module, and few have markers: SciPy's filters load slowly.
    from scipy.signal import butter, sosfiltfilt

    high = butter(2, CUT_HZ, "high", fs=fps, output="sos")
    return np.asarray(sosfiltfilt(high, series - series.mean(axis=0), axis=0), np.float64)


def _carried(pelvis: Frame, hip_m: NDArray) -> NDArray[np.float64]:
    """(T, 3) a hip joint where it lies in the pelvis on average."""
    inside_m = pelvis.local_mm(hip_m).mean(axis=0) / 1e3
    return pelvis.places_m + pelvis.turns @ inside_m


def _limb_frame(start_m: NDArray, end_m: NDArray, bone: NDArray, good: NDArray) -> Frame:
    """The bone's frame (T, 3, 3), turned the short way so that its long axis is the markers'."""
    axis = unit(end_m - start_m)
    mean = np.einsum("tyx,ty->tx", bone, axis)[good].mean(axis=0)
    return Frame(shortest_turn(bone @ mean, axis) @ bone, end_m, good)


def _rigid_frame(cloud: Cloud, labels: list[str], bone: NDArray, weights: NDArray | None) -> Frame:
    points = np.stack([cloud.points_m[label] for label in labels], axis=1)
    seen = np.stack([cloud.seen[label] for label in labels], axis=1)
    turns, places, weights = rigid_motion(points, seen, weights)
    mean = Rotation.from_matrix(np.einsum("tyx,tyz->txz", bone, turns)).mean().as_matrix()
    return Frame(turns @ mean.T, places, seen.sum(axis=1) > 2, weights)


def rigid_motion(
    points_m: NDArray, seen: NDArray[np.bool_], weights: NDArray | None = None
) -> tuple[NDArray, NDArray, NDArray]:
    """The motion of N points that keep their mean shape as well as they can (Kabsch).

    Points are weighted by how still they are against the others, unless `weights` (N,) are given.
    One that is not seen is left out first, and then stands where it lay before and after: the
    frame does not jump when a marker comes or goes.

    Parameters
    ----------
    points_m : (T, N, 3). seen : (T, N).

    Returns
    -------
    Turns (T, 3, 3), places (T, 3), weights (N,).
    """
    # Where fewer than three are seen their bridges stand in; such frames are not scored.
    seen = seen | (seen.sum(axis=1, keepdims=True) < 3)
    first = int(np.argmax(seen.all(axis=1)))
    shape = points_m[first] - points_m[first].mean(axis=0)
    trust = np.ones(len(shape)) if weights is None else weights
    for _ in range(_ROUNDS):
        turns, places = kabsch(points_m, shape, seen * trust)
        inside = np.einsum("tyx,tny->tnx", turns, points_m - places[:, None])
        there = seen[..., None]
        shape = (there * inside).sum(axis=0) / there.sum(axis=0)
        if weights is None:
            squares = (there * (inside - shape) ** 2).sum(axis=(0, 2)) / seen.sum(axis=0)
            trust = 1 / (squares + _STILL_M**2)
    if seen.all():
        return turns, places, trust
    whole = np.stack([bridged(inside[:, i], seen[:, i]) for i in range(len(shape))], axis=1)
    whole_m = places[:, None] + np.einsum("txy,tny->tnx", turns, whole)
    return rigid_motion(whole_m, np.ones_like(seen), trust)


def kabsch(points: NDArray, shape: NDArray, weights: NDArray) -> tuple[NDArray, NDArray]:
    """Turns (T, 3, 3) and places (T, 3) that bring a shape (N, 3) nearest to points (T, N, 3)."""
    total = weights.sum(axis=1, keepdims=True)
    centre = np.einsum("tn,tnx->tx", weights, points) / total
    middle = (weights @ shape) / total
    covariance = np.einsum(
        "tn,tnx,tny->txy", weights, points - centre[:, None], shape - middle[:, None]
    )
    u, _, vt = np.linalg.svd(covariance)
    u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
    turns = u @ vt
    return turns, centre - np.einsum("txy,ty->tx", turns, middle)
