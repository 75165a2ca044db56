"""Read recordings with skin markers, and prepare them for a fit of soft-tissue constants.

Of each motion only the part that shakes soft tissue most is used.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.errors import DsnetError, notify
from bridge.motion import Motion
from bridge.motion.motion_checks import MOST_FALL_G, steepest_fall_g
from bridge.tissue.oscillators import node_loads
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.markers.bone_pose import bone_motion
from dsnet.markers.lone import Lone, lone_motion
from dsnet.markers.marker_files import is_lone, load_recording, markers_of
from dsnet.markers.registration import SPOTS, Registered, register
from dsnet.markers.segments import SEGMENTS, Cloud, Frame, Pose, faster, segment_frames
from dsnet.markers.skin import at_spots
from dsnet.prediction.controls import root_joint_m
from dsnet.prediction.models import PlusModel, codes_of
from dsnet.prediction.shape_space import with_betas_on

LEAST_S, MOST_S = 2.0, 8.0
"""Seconds of a motion: less shows no oscillation, more adds little."""
_LIMB_MARKERS = {
    "thorax": ("LELB", "RELB"),
    "pelvis": ("LKNE", "RKNE"),
    **{f"{side}thigh": (f"{side}ANK",) for side in "LR"},
    **{f"{side}calf": (f"{side}TOE",) for side in "LR"},
    **{f"{side}arm": (f"{side}LOWR", f"{side}IWR") for side in "LR"},
}
"""Markers on the limbs next to a segment, whose motion pulls at its skin."""
_LIMB_M = 0.3
"""Their coordinates are divided by the length of a limb."""


@dataclass(frozen=True, eq=False)
class Series:
    """The motion of one soft marker in its segment's frame beyond skinning, above 1.2 Hz."""

    doubt: str
    """Why its segment's frame is uncertain, empty if it is not."""
    moved_mm: NDArray[np.float64]
    """(T, 3) displacement."""
    good: NDArray[np.bool_]
    """(T,) frames that count."""
    rotations: NDArray[np.float64]
    """(T, 3, 3) from offsets in the rest pose to the segment's frame."""
    node_weights: NDArray[np.float64]
    """(K,) interpolation weights of the nodes at its vertex."""
    limbs: NDArray[np.float64]
    """(T, Q) coordinates of markers on neighbouring limbs, in lengths of a limb. The part of the
    displacement that is linear in them is skin pulled by limbs."""


@dataclass(frozen=True, eq=False)
class Clip:
    """Data of one motion for a fit."""

    load: NDArray[np.float64]
    """(T, K, 3) load on the nodes, m/s^2."""
    series: Mapping[str, list[Series]]
    """Series of the soft markers by part of the body."""
    fps: float


@dataclass(frozen=True, eq=False)
class Recording:
    """Markers registered to a body, and the motion of its bones as estimated so far."""

    body: BodyModelData
    filed: Motion
    """The pose of the file, which may follow soft tissue."""
    motion: Motion
    """The pose with the chest from markers on bone."""
    registered: Registered


def read_recording(path: Path, body: BodyModelData) -> Recording:
    """Read the part of a motion file that is fitted, and take the pose of its chest from markers.

    Betas are fitted to the markers if those of the file are of another body model; pose and betas
    to those on bone if no pose lies beside a recording.

    Raises
    ------
    DsnetError
        If the file has no markers, none on bone of the chest or none on soft tissue, if its longest
        piece without a cut is too short, or if its frame rate contradicts gravity.
    """
    if is_lone(path):
        motion = lone_motion(body, Lone.read(path))
    else:
        motion = with_betas_on(load_recording(path), body, warn=False)
    markers = markers_of(motion)
    if markers.note:
        notify(f"{path}: {markers.note}")
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
            f"its true rate, of some {motion.source_fps / np.sqrt(fall_g):.0f} fps",
            "Write the true rate into a copy of the file.",
        )
    cloud = Cloud(
        {label: points[frames] for label, points in registered.cloud.points_m.items()},
        {label: seen[frames] for label, seen in registered.cloud.seen.items()},
    )
    motion = replace(motion.frames(frames), theta=np.asarray(motion.theta[frames], np.float64))
    bony = bone_motion(body, motion, cloud)
    return Recording(body, motion, bony, replace(registered, cloud=cloud))


def liveliest(motion: Motion) -> slice:
    """The `MOST_S` seconds without a cut in which the root accelerates most."""
    piece = max(motion.pieces, key=lambda one: one.stop - one.start)
    most = int(MOST_S * motion.fps)
    acceleration = np.square(np.diff(motion.theta[piece, -3:], n=2, axis=0)).sum(axis=1)
    if len(acceleration) + 2 <= most:
        return piece
    # Limit outliers: a single wild frame is an error of the pose.
    acceleration = np.minimum(acceleration, np.quantile(acceleration, 0.99))
    total = np.cumsum(np.r_[0, acceleration])
    first = piece.start + int(np.argmax(total[most:] - total[:-most]))
    return slice(first, first + most)


def clip_to_fit(recording: Recording, model: PlusModel) -> tuple[Recording, Clip]:
    """The data of a recording for a fit, and the recording with an improved pose of the bones.

    Markers on bone move a little with the skin. The model's prediction of that is subtracted before
    the frames of the segments and the pose of the chest are computed again.
    """
    body, trained, motion = recording.body, model.trained, recording.motion
    vertices = recording.registered.vertices
    node_weights = trained.nodes.reading(np.array([*vertices.values()]))
    codes = np.stack([*codes_of(model, motion.theta, motion.betas)])
    rotations = _rotations(body, Pose.of(body, motion), vertices.values())
    offsets_m = np.einsum("tvxy,tyk,vk->tvx", rotations, codes, node_weights, optimize=True)
    on_bone = {label for segment in SEGMENTS.values() for label in segment.labels}
    points_m = dict(recording.registered.cloud.points_m)
    for column, label in enumerate(vertices):
        if label in on_bone:
            points_m[label] = points_m[label] - offsets_m[:, column]
    cloud = Cloud(points_m, recording.registered.cloud.seen)
    motion = bone_motion(body, recording.filed, cloud)
    recording = replace(recording, motion=motion)
    load, series = driving_load(trained, body, motion), _series(recording, cloud, node_weights)
    return recording, Clip(load, series, motion.fps)


def _series(recording: Recording, cloud: Cloud, node_weights: NDArray) -> dict[str, list[Series]]:
    body, motion, vertices = recording.body, recording.motion, recording.registered.vertices
    pose, skinned, fps = Pose.of(body, motion), recording.registered.posed(body, motion), motion.fps
    frames = segment_frames(cloud, pose)
    skinned_frames = segment_frames(skinned, pose, frames)
    rotations = _rotations(body, pose, vertices.values())
    columns = {label: column for column, label in enumerate(vertices)}
    series: dict[str, list[Series]] = {}
    for label, spot, moved_mm, good in at_spots(cloud, frames, fps):
        if not spot.flesh or label not in columns:
            continue
        column, frame = columns[label], skinned_frames[spot.segment]
        series.setdefault(spot.flesh, []).append(
            Series(
                SEGMENTS[spot.segment].doubt,
                faster(moved_mm - frame.local_mm(skinned.points_m[label]), fps),
                good,
                frame.turns.swapaxes(1, 2) @ rotations[:, column],
                node_weights[column],
                _limb_coordinates(cloud, spot.segment, frames[spot.segment], fps),
            )
        )
    return series


def _rotations(body: BodyModelData, pose: Pose, vertices: Iterable[int]) -> NDArray[np.float64]:
    """(T, N, 3, 3) linear parts of skinning: from offsets in the rest pose to the world."""
    return np.einsum("vj,tjxy->tvxy", body.weights[[*vertices]], pose.turns)


def driving_load(model: TrainedPlus, body: BodyModelData, motion: Motion) -> NDArray[np.float64]:
    """(T, K, 3) load that moves the nodes from each frame to the next, m/s^2."""
    load = node_loads(body, model.nodes.vertices, motion.betas, motion.theta, motion.fps)
    inertia, gravity = (np.exp(model.weights.base[f"{n}_gain"]) for n in ("inertia", "gravity"))
    total = inertia * load.inertia + gravity * load.gravity
    frames, taps = np.arange(len(load)) + model.look_ahead, model.weights.taps
    rows = (np.clip(frames - delay, 0, len(load) - 1) for delay in range(len(taps)))
    return np.sum([tap * total[row] for tap, row in zip(taps, rows, strict=True)], 0)


def _limb_coordinates(cloud: Cloud, segment: str, frame: Frame, fps: float) -> NDArray[np.float64]:
    labels = [label for label in _LIMB_MARKERS[segment] if label in cloud.points_m]
    places = [frame.local_mm(cloud.points_m[label])[:, 1:] / (1e3 * _LIMB_M) for label in labels]
    empty = np.zeros((len(frame.good), 0))
    return np.concatenate([empty, *(faster(one, fps) for one in places)], axis=1)
