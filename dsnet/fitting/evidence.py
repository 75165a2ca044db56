"""What a motion's markers say of soft regions, ready to be fitted: series, and the loads that drove
them, of the part of the motion that shakes flesh most."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.errors import DsnetError
from bridge.motion import Motion
from bridge.motion.cuts import pieces_between_cuts
from bridge.motion.motion_checks import MOST_FALL_G, steepest_fall_g
from bridge.tissue.oscillators import node_loads
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.markers.bone_pose import bone_motion
from dsnet.markers.marker_files import load_recording, markers_of
from dsnet.markers.registration import SPOTS, Registered, register
from dsnet.markers.segments import SEGMENTS, Cloud, Frame, Pose, faster, segment_frames
from dsnet.markers.skin import at_spots
from dsnet.prediction.controls import root_joint_m
from dsnet.prediction.models import PlusModel, codes_of
from dsnet.prediction.shape_space import with_betas_on

LEAST_S, MOST_S = 2.0, 8.0
"""Of a motion: less shows no swing, more says the same again."""
_PULLS = {
    "thorax": ("LELB", "RELB"),
    "pelvis": ("LKNE", "RKNE"),
    **{f"{side}thigh": (f"{side}ANK",) for side in "LR"},
    **{f"{side}calf": (f"{side}TOE",) for side in "LR"},
    **{f"{side}arm": (f"{side}LOWR", f"{side}IWR") for side in "LR"},
}
"""Markers beyond a segment's joints: skin is pulled as they rise and reach out."""
_LIMB_M = 0.3


@dataclass(frozen=True, eq=False)
class Series:
    """One marker in its segment's frame, what skinning explains taken off, above 1.2 Hz."""

    doubt: str
    moved_mm: NDArray[np.float64]
    """(T, 3)."""
    good: NDArray[np.bool_]
    """(T,) frames that count."""
    turns: NDArray[np.float64]
    """(T, 3, 3) from offsets in the rest pose to the segment's frame."""
    reading: NDArray[np.float64]
    """(K,) weights of the nodes at its vertex."""
    pulls: NDArray[np.float64]
    """(T, Q) where the limbs beyond are, in lengths of one: what they pull at is not flesh's."""


@dataclass(frozen=True, eq=False)
class Clip:
    """Markers of one motion by part of the body, and the load (T, K, 3) on the nodes."""

    load: NDArray[np.float64]
    series: Mapping[str, list[Series]]
    fps: float


@dataclass(frozen=True, eq=False)
class Take:
    """Markers in a body's world, and the motion of its bones as far as it is known."""

    body: BodyModelData
    filed: Motion
    """The pose of the file, which may hold what flesh does."""
    motion: Motion
    registered: Registered


def read_take(path: Path, body: BodyModelData) -> Take:
    """The part of a file's motion that is fitted, its chest by markers on bone, its shape by all
    where the file's betas are not the body's.

    `DsnetError` if it has no markers, none on the bone of the chest, or none on soft places, or
    says a rate at which nobody falls.
    """
    motion = with_betas_on(load_recording(path), body, warn=False)
    markers = markers_of(motion)
    motion = motion.about_root_joint(root_joint_m(body, motion.betas))
    registered = register(body, motion, markers)
    if not any(spot.flesh and label in registered.vertices for label, spot in SPOTS.items()):
        raise DsnetError(
            f"{path}, without markers on soft places",
            "LBUST, MBLLY, LBUM, LTHI or the like",
            "Name them as AMASS does.",
        )
    frames = liveliest(motion)
    if frames.stop - frames.start < LEAST_S * motion.fps:
        raise DsnetError(
            f"{path}, whose longest piece without a cut is shorter than {LEAST_S:g} s",
            "a longer one",
            "Pass another file.",
        )
    if (fall_g := steepest_fall_g(motion.trans_m[frames, 1], motion.fps)) > MOST_FALL_G:
        raise DsnetError(
            f"{path}, which falls with {fall_g:.1f} times gravity at its {motion.source_fps:g} fps",
            f"its true rate, of some {motion.source_fps / np.sqrt(fall_g):.0f}: flesh is timed",
            "Write the true rate into a copy of the file.",
        )
    cloud = Cloud(
        {label: points[frames] for label, points in registered.cloud.points_m.items()},
        {label: seen[frames] for label, seen in registered.cloud.seen.items()},
    )
    motion = replace(motion.frames(frames), theta=np.asarray(motion.theta[frames], np.float64))
    bony = bone_motion(body, motion, cloud)
    return Take(body, motion, bony, replace(registered, cloud=cloud))


def liveliest(motion: Motion) -> slice:
    """The frames without a cut, at most `MOST_S` of them, in which the root is jolted most."""
    piece = max(pieces_between_cuts(motion.theta), key=lambda one: one.stop - one.start)
    most = int(MOST_S * motion.fps)
    jolt = np.square(np.diff(motion.theta[piece, -3:], n=2, axis=0)).sum(axis=1)
    if len(jolt) + 2 <= most:
        return piece
    jolt = np.minimum(jolt, np.quantile(jolt, 0.99))  # one wild frame is an error of the pose
    total = np.cumsum(np.r_[0, jolt])
    first = piece.start + int(np.argmax(total[most:] - total[:-most]))
    return slice(first, first + most)


def evidence(take: Take, model: PlusModel) -> tuple[Take, Clip]:
    """What is fitted, and the take with bones that a model's flesh was taken off.

    Markers on bone ride on skin that moves a little: what the model makes of it is taken off them
    before the frames of the segments, and the pose of the chest, are found anew.
    """
    body, trained, motion = take.body, model.trained, take.motion
    vertices = take.registered.vertices
    reading = trained.nodes.reading(np.array([*vertices.values()]))
    codes = np.stack([*codes_of(model, motion.theta, motion.betas)])
    turns = _turns(body, Pose.of(body, motion), vertices.values())
    flesh_m = np.einsum("tvxy,tyk,vk->tvx", turns, codes, reading, optimize=True)
    on_bone = {label for segment in SEGMENTS.values() for label in segment.labels}
    points_m = dict(take.registered.cloud.points_m)
    for column, label in enumerate(vertices):
        if label in on_bone:
            points_m[label] = points_m[label] - flesh_m[:, column]
    bare_cloud = Cloud(points_m, take.registered.cloud.seen)
    motion = bone_motion(body, take.filed, bare_cloud)
    found = replace(take, motion=motion)
    return found, Clip(
        driving_load(trained, body, motion), _series(found, bare_cloud, reading), motion.fps
    )


def _series(take: Take, cloud: Cloud, reading: NDArray) -> dict[str, list[Series]]:
    body, motion, vertices = take.body, take.motion, take.registered.vertices
    pose, bare, fps = Pose.of(body, motion), take.registered.posed(body, motion), motion.fps
    real = segment_frames(cloud, pose)
    posed = segment_frames(bare, pose, real)
    turns, columns = _turns(body, pose, vertices.values()), {n: k for k, n in enumerate(vertices)}
    series: dict[str, list[Series]] = {}
    for label, spot, moved_mm, good in at_spots(cloud, real, fps):
        if not spot.flesh or label not in columns:
            continue
        column, alone = columns[label], posed[spot.segment]
        series.setdefault(spot.flesh, []).append(
            Series(
                SEGMENTS[spot.segment].doubt,
                faster(moved_mm - alone.local_mm(bare.points_m[label]), fps),
                good,
                alone.turns.swapaxes(1, 2) @ turns[:, column],
                reading[column],
                _pulls(cloud, spot.segment, real[spot.segment], fps),
            )
        )
    return series


def _turns(body: BodyModelData, pose: Pose, vertices: Iterable[int]) -> NDArray[np.float64]:
    """(T, N, 3, 3) that turn offsets of vertices from the rest pose to the world."""
    return np.einsum("vj,tjxy->tvxy", body.weights[[*vertices]], pose.turns)


def driving_load(model: TrainedPlus, body: BodyModelData, motion: Motion) -> NDArray[np.float64]:
    """(T, K, 3) what moves the nodes from each frame to the next."""
    load = node_loads(body, model.nodes.vertices, motion.betas, motion.theta, motion.fps)
    inertia, gravity = (np.exp(model.weights.base[f"{n}_gain"]) for n in ("inertia", "gravity"))
    whole = inertia * load.inertia + gravity * load.gravity
    frames = np.arange(len(load)) + model.look_ahead
    rows = (np.clip(frames - late, 0, len(load) - 1) for late in range(len(model.weights.taps)))
    return np.sum([tap * whole[row] for tap, row in zip(model.weights.taps, rows, strict=True)], 0)


def _pulls(cloud: Cloud, segment: str, frame: Frame, fps: float) -> NDArray[np.float64]:
    there = [label for label in _PULLS[segment] if label in cloud.points_m]
    found = [frame.local_mm(cloud.points_m[label])[:, 1:] / (1e3 * _LIMB_M) for label in there]
    empty = np.zeros((len(frame.good), 0))
    return np.concatenate([empty, *(faster(one, fps) for one in found)], axis=1)
