"""Markers on a body: rigid registration, and the vertex of each, by the soft place it is on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from bridge.body import BodyModelData
from bridge.body.parts import PARTS, part_weights
from bridge.body.posing import Smpl
from bridge.body.surface_operators import vertex_normals
from bridge.errors import DsnetError, notify
from bridge.motion import Motion, unpack_theta
from dsnet.markers.marker_files import Markers
from dsnet.markers.segments import SIDES, Cloud

_LOOKED_AT = 24
"""Frames, spread over the motion, in which markers and body are brought together."""
_NEAREST = 0.8
"""Part of the markers that the registration goes by: those on hair and props lie far off."""
_MOST_OFF_MM = 80.0
_SHORTEST_S, _MOST_APART_S = 2.0, 0.1
_STRAYED_M, _STILL_M, _BESIDE_MM = 0.3, 0.02, 100.0
"""How far off its vertex a marker is not seen in a frame, how far that moves beside one that is
held in place, and how far beyond the median a marker is left out."""
_CLEARLY, _NEARER = 0.8, 0.9
"""Part of what markers swing about their vertices: less is left where another moment fits."""
_OUTWARD = 0.1
"""Of a marker's squared distance along the skin's normal: people are thicker than their betas say
on another body model, and markers stand 9.5 mm off the skin."""


@dataclass(frozen=True)
class Spot:
    """A place that has a marker, soft or on bone."""

    region: str
    segment: str
    parts: tuple[str, ...]
    """Parts of the body among whose vertices it lies."""
    flesh: str
    """Which of `SOFT` it measures, if any."""


def _spots() -> Iterator[tuple[str, Spot]]:
    """By label; `*` stands for either side."""
    for region, segment, labels, parts, flesh in (
        ("bust, *", "thorax", "*BUST *BUSTLO", "chest belly", "chest"),
        ("breastbone", "thorax", "STRN", "chest belly", ""),
        ("belly", "pelvis", "MBLLY", "belly", "belly"),
        ("buttocks", "pelvis", "LBUM RBUM", "buttocks thighs", "buttocks"),
        ("thigh front, *", "*thigh", "*FTHI *FTHIIN", "thighs", "thighs"),
        ("thigh side, *", "*thigh", "*THI", "thighs buttocks", "thighs"),
        ("calf, *", "*calf", "*TIB *TIBIN", "calves", "calves"),
        ("upper arm, *", "*arm", "*BCEP *UPA", "upper_arms", "upper_arms"),
        ("cheeks", "head", "LCHEECK RCHEECK", "head", ""),
    ):
        for side, word in SIDES.items() if "*" in region else [("", "")]:
            for label in labels.replace("*", side).split():
                where = region.replace("*", word), segment.replace("*", side)
                yield label, Spot(*where, tuple(parts.split()), flesh)


SPOTS = dict(_spots())
SOFT = tuple(dict.fromkeys(spot.flesh for spot in SPOTS.values() if spot.flesh))
"""Parts of the body whose flesh has markers."""


@dataclass(frozen=True, eq=False)
class Registered:
    """Markers in the body's world, each with its vertex."""

    cloud: Cloud
    vertices: dict[str, int]
    distance_mm: dict[str, float]

    def posed(self, body: BodyModelData, motion: Motion, offsets_m: NDArray | None = None) -> Cloud:
        """The vertices' places in a motion, perhaps with offsets (T, V, 3) of the rest pose."""
        vertices = [*self.vertices.values()]
        person = Smpl(body, np.array(vertices), np.float64).person(motion.betas)
        own_m = None if offsets_m is None else np.asarray(offsets_m[:, vertices], np.float64)
        places_m = np.asarray(person.pose(*unpack_theta(motion.theta), own_m), np.float64)
        always = np.ones(len(places_m), bool)
        return Cloud(
            {label: places_m[:, i] for i, label in enumerate(self.vertices)},
            dict.fromkeys(self.vertices, always),
        )


def register(
    body: BodyModelData, motion: Motion, markers: Markers, to_measure: bool = True
) -> Registered:
    """Bring markers to the body by a turn about the vertical and a shift, the same for all frames:
    the body of the betas is not quite the person. Says on stderr which lie off it and are left out.

    `DsnetError` if the markers do not lie on the body, lie on its other side or do not last as
    long; if it is `to_measure`, also if they are of other moments, or the motion is too short.

    Parameters
    ----------
    body : that moves.
    motion : of T frames, y up, about the body's root joint.
    """
    if to_measure and motion.duration_s < _SHORTEST_S:
        raise DsnetError(
            f"{motion.source}, a motion of {motion.duration_s:.2f} s",
            f"at least {_SHORTEST_S:g} s",
            "Pass a longer one.",
        )
    markers_s = (len(markers.points_m) - 1) / markers.fps
    if abs(markers_s - motion.duration_s) > _MOST_APART_S:
        raise DsnetError(
            f"{motion.source}, markers of {markers_s:.2f} s beside a pose of "
            f"{motion.duration_s:.2f} s",
            "a row of markers for each frame of the pose",
            "Store both at one rate.",
        )
    cloud = markers.at(motion.fps, len(motion.theta))
    some = np.linspace(0, len(motion.theta) - 1, min(len(motion.theta), _LOOKED_AT)).astype(int)
    pose, trans = unpack_theta(motion.theta[some])
    skin = np.asarray(Smpl(body, dtype=np.float64).person(motion.betas).pose(pose, trans))
    points = np.stack(list(cloud.points_m.values()), axis=1)[some]
    turn, shift = _yaw_and_shift(points, skin)
    moved = {label: points_m @ turn.T + shift for label, points_m in cloud.points_m.items()}
    stated = markers.vertices if body.source == "licensed" else {}  # other bodies' count otherwise
    vertices, distance = nearest_vertices(
        body, skin, {k: v[some] for k, v in moved.items()}, stated
    )
    if (off := float(np.median(list(distance.values())))) > _MOST_OFF_MM:
        raise DsnetError(
            f"{motion.source}, whose markers lie {off:.0f} mm off the body (median)",
            f"at most {_MOST_OFF_MM:.0f}: markers and pose of one recording, at one rate",
            "Check that markers and pose are of the same take.",
        )
    _refuse_other_side(body, motion, vertices)
    skin_m = Registered(cloud, vertices, distance).posed(body, motion).points_m
    near = {label: skin_m[label] for label, mm in distance.items() if mm < off + _BESIDE_MM}
    cloud = _near(markers, markers.points_m @ turn.T + shift, near, motion)
    if not cloud.seen:
        raise DsnetError(
            f"{motion.source}, none of whose markers stays on the body",
            "markers and pose of one recording",
            "Check that markers and pose are of the same take.",
        )
    moved = {label: points_m @ turn.T + shift for label, points_m in cloud.points_m.items()}
    cloud = Cloud(moved, cloud.seen)
    if to_measure:
        lost = [
            f"{k}, {mm:.0f} mm off the skin" for k, mm in distance.items() if k not in cloud.seen
        ]
        if lost:
            notify(f"{motion.source}: markers left out: {'; '.join(lost)}")
        _refuse_other_moment(motion, cloud, near)
    vertices, distance = (
        {label: each[label] for label in cloud.seen} for each in (vertices, distance)
    )
    return Registered(cloud, vertices, distance)


def _refuse_other_side(body: BodyModelData, motion: Motion, vertices: Mapping[str, int]) -> None:
    """Where most names of a side are on the other: x of the rest pose is to the left."""
    sided = {label: v for label, v in vertices.items() if label[0] in SIDES}
    right = [(body.v_template[v, 0] > 0) == (label[0] == "L") for label, v in sided.items()]
    if right and np.mean(right) < 0.5:
        raise DsnetError(
            f"{motion.source}, whose markers {', '.join([*sided][:3])}, ... lie on the other side",
            "those named L on the body's left",
            "Exchange L and R, or mirror the markers back.",
        )


def _near(
    markers: Markers, world_m: NDArray, skin_m: Mapping[str, NDArray], motion: Motion
) -> Cloud:
    """Markers, seen where in the body's world they are near their places (T, 3) on the skin."""
    times = np.arange(len(markers.points_m)) * (motion.fps / markers.fps)
    frames = np.minimum(times.round().astype(int), len(motion.theta) - 1)
    nowhere = np.full((len(motion.theta), 3), np.nan)
    places = np.stack([skin_m.get(k, nowhere)[frames] for k in markers.labels], axis=1)
    near = np.linalg.norm(world_m - places, axis=2) < _STRAYED_M
    held = np.zeros_like(near)  # where a gap was filled with one place, while the skin moves
    held[1:] = (np.diff(markers.points_m, axis=0) == 0).all(axis=2)
    for column, same in enumerate(held.T):
        for first, end in np.flatnonzero(np.diff(np.r_[0, same, 0])).reshape(-1, 2):
            near[first:end, column] &= np.ptp(places[first:end, column], axis=0).max() < _STILL_M
    seen_m = np.where(near[..., None], markers.points_m, np.nan)
    return replace(markers, points_m=seen_m).at(motion.fps, len(motion.theta))


def _refuse_other_moment(motion: Motion, cloud: Cloud, skin_m: Mapping[str, NDArray]) -> None:
    """Where markers stay clearly stiller beside their places (T, 3) on skin of frames before or
    after."""
    most = int(_MOST_APART_S * motion.fps)
    real, posed = (
        np.stack([one[k] for k in cloud.seen], axis=1) for one in (cloud.points_m, skin_m)
    )
    inner = posed[most : len(posed) - most]
    swings = [
        np.median(np.linalg.norm(np.std(real[first : first + len(inner)] - inner, axis=0), axis=1))
        for first in range(2 * most + 1)
    ]
    best = int(np.argmin(swings))
    if swings[best] < _CLEARLY * swings[most]:
        raise DsnetError(
            f"{motion.source}, whose markers come {abs(best - most) / motion.fps:.2f} s too "
            f"{'late' if best > most else 'early'}",
            "a row of markers for each frame of the pose",
            "Cut both to the same moments.",
        )


def _yaw_and_shift(
    points: NDArray, skin: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """From where the markers are, or from the best of 16 turns where that ends nearer."""
    trees = [KDTree(frame) for frame in skin]
    few, fits = (points[::4], skin[::4], trees[::4]), []
    for turn in Rotation.from_rotvec(np.pi / 8 * np.outer(np.arange(16), [0, 1, 0])).as_matrix():
        shift = np.median(skin, axis=(0, 1)) - np.median(points @ turn.T, axis=(0, 1))
        fits.append(_closest(*few, turn, shift))
    _, turn, shift = min(fits, key=lambda one: one[0])
    turned = _closest(points, skin, trees, turn, shift, rounds=50)
    as_is = _closest(points, skin, trees, np.eye(3), np.zeros(3))
    return (turned if turned[0] < _NEARER * as_is[0] else as_is)[1:]


def _closest(
    points: NDArray,
    skin: NDArray,
    trees: list[KDTree],
    turn: NDArray,
    shift: NDArray,
    rounds: int = 25,
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Iterated closest points, restricted to a turn about y and a shift; how far off first."""
    most = 0.0
    for _ in range(rounds):
        moved = points @ turn.T + shift
        near = np.stack([v[t.query(x)[1]] for v, t, x in zip(skin, trees, moved, strict=True)])
        one, two = moved.reshape(-1, 3), near.reshape(-1, 3)
        apart = np.linalg.norm(one - two, axis=1)
        keep = apart <= (most := float(np.quantile(apart, _NEAREST)))
        one_mid, two_mid = one[keep].mean(axis=0), two[keep].mean(axis=0)
        a, b = one[keep] - one_mid, two[keep] - two_mid
        sine = (b[:, 0] * a[:, 2] - b[:, 2] * a[:, 0]).sum()
        cosine = (a[:, [0, 2]] * b[:, [0, 2]]).sum()
        step = Rotation.from_euler("y", np.arctan2(sine, cosine)).as_matrix()
        turn, shift = step @ turn, step @ (shift - one_mid) + two_mid
    return most, turn, shift


def nearest_vertices(
    body: BodyModelData, skin: NDArray, markers: dict[str, NDArray], stated: Mapping[str, int]
) -> tuple[dict[str, int], dict[str, float]]:
    """Of each marker (K, 3) the vertex that its file states, or that stays nearest, and how far
    off, millimetres."""
    normals = np.stack([vertex_normals(frame, body.faces) for frame in skin])
    parts, vertices, distance = part_weights(body), {}, {}
    for label, points in markers.items():
        there = np.arange(body.vertex_count)
        if label in stated:
            there = np.array([stated[label]])
        elif label in SPOTS:
            columns = [PARTS.index(name) for name in SPOTS[label].parts]
            there = np.flatnonzero(parts[:, columns].sum(axis=1) > 0.5)
        away = points[:, None] - skin[:, there]
        outward = np.maximum(np.einsum("tvc,tvc->tv", away, normals[:, there]), 0)
        squared = np.einsum("tvc,tvc->tv", away, away)
        weighed = np.minimum(squared - (1 - _OUTWARD) * outward**2, _STRAYED_M**2)
        best = int(weighed.mean(axis=0).argmin())
        vertices[label] = int(there[best])
        away_m = np.sqrt(squared[:, best])
        near = away_m < _STRAYED_M
        distance[label] = float(1e3 * away_m[near if near.mean() > 0.5 else ...].mean())
    return vertices, distance
