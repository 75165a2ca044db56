"""A body that is fitted to markers on bone alone, where a recording has no pose beside it.

What MoSh does with all markers is done here with those that do not ride on flesh: one shape and one
place of each marker on the skin for all frames, a pose for each. Damped steps of Gauss and Newton
with analytic slopes: first poses on the mean shape, then shape, places and poses together in some
frames, then poses in all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.body import BodyModelData
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.posing import pose_features, shaped_joints
from bridge.body.surface_operators import vertex_normals
from bridge.paper import N_BETAS, N_JOINTS
from dsnet.markers.places import ON_BONE, bony_vertices
from dsnet.markers.segments import SIDES, Cloud, kabsch

_STANDOFF_M = 0.0095
_MARKER_M, _PLACE_M, _ASTRAY_M = 0.006, 0.02, 0.03
"""How far skin slides over bone, how far from its named place a marker may be stuck, and from which
distance on a marker counts less and less."""
_TOGETHER, _AT_ONCE = 24, 128
"""Frames in which shape and places are sought, and frames that are posed at once."""
_BRIDGED = 0.05
"""What a marker counts where it was not seen, at a smooth bridge over the gap: no limb falls back
to its usual pose there."""
_ROUNDS, _MORE_ROUNDS, _DAMPING, _LONGEST_RAD = 15, 8, 0.3, 0.5
_TRUNK = (("SACR", "LASI", "RASI", "LPSI", "RPSI", "LFWT", "RFWT", "LBWT", "RBWT"),
          ("C7", "T8", "T10", "CLAV", "STRN", "LSHO", "RSHO"))  # fmt: skip
"""Where three of one are seen, a body stands in the world."""
FEWEST = 8
"""Markers on bone that a body is fitted to."""

_USUAL = {
    "*_hip": ((0.1, 0, 0), (0.7, 0.3, 0.3)), "*_knee": ((0.4, 0, 0), (0.7, 0.08, 0.08)),
    "*_ankle": ((0, 0, 0), (0.3, 0.2, 0.2)), "*_foot": ((0, 0, 0), (0.15, 0.05, 0.05)),
    "spine1": ((0, 0, 0), (0.15, 0.1, 0.1)), "spine2": ((0, 0, 0), (0.15, 0.1, 0.1)),
    "spine3": ((0, 0, 0), (0.15, 0.1, 0.1)), "neck": ((0, 0, 0), (0.2, 0.2, 0.2)),
    "head": ((0, 0, 0), (0.2, 0.2, 0.2)), "*_collar": ((0, 0, 0), (0.15, 0.15, 0.15)),
    "*_shoulder": ((0, 0, -1), (1, 1, 1)), "*_elbow": ((0, -0.4, 0), (0.4, 0.8, 0.1)),
    "*_wrist": ((0, 0, 0), (0.3, 0.3, 0.3)),
}  # fmt: skip
"""Where a joint usually is turned to and by how much it differs from that: axis-angle, radians, of
the left side; on the right one what turns about y and z is mirrored."""


@dataclass(frozen=True, eq=False)
class FittedBody:
    """A body in the pose of markers on bone."""

    betas: NDArray[np.float64]
    pose: NDArray[np.float64]
    """(T, 22, 3) axis-angle, radians."""
    trans_m: NDArray[np.float64]
    """(T, 3)."""
    residual_mm: dict[str, float]
    """How far each marker is from its place, median over the frames in which it is seen."""


def markers_to_fit(cloud: Cloud) -> list[str]:
    """The markers on bone that tell where a body is; none where they are too few."""
    labels = [label for label in cloud.points_m if label in ON_BONE]
    stands = any(sum(label in trunk for label in labels) > 2 for trunk in _TRUNK)
    return labels if stands and len(labels) >= FEWEST else []


def fit_body(body: BodyModelData, cloud: Cloud, labels: list[str]) -> FittedBody:
    """Fit shape and poses of a body to the markers on bone `labels` of a cloud, y up."""
    points_m = np.stack([cloud.points_m[label] for label in labels], axis=1)
    seen = np.stack([cloud.seen[label] for label in labels], axis=1)
    trust = np.where(seen, 1.0, _BRIDGED)
    skin = _Skin(body, bony_vertices(body, labels))
    turns, roots_m = _standing(skin, points_m, trust, labels)
    some = np.unique(np.linspace(0, len(points_m) - 1, _TOGETHER).astype(int))
    for together in (False, True):
        few = turns[some], roots_m[some]
        turns[some], roots_m[some] = _fitted(skin, *few, points_m[some], trust[some], together)
    for start in range(0, len(points_m), _AT_ONCE):
        now = slice(start, start + _AT_ONCE)
        # From the nearest of the frames that are posed already.
        near = some[np.abs(np.arange(len(points_m))[now, None] - some).argmin(axis=1)]
        turns[now, 1:] = turns[near, 1:]
        near_m = turns[now], roots_m[now]
        there = points_m[now], trust[now]
        turns[now], roots_m[now] = _fitted(skin, *near_m, *there, rounds=_MORE_ROUNDS)
    off_m = np.linalg.norm(skin.places(turns, roots_m).places_m - points_m, axis=2)
    off_mm = 1e3 * np.nanmedian(np.where(seen, off_m, np.nan), axis=0)
    rotvecs = Rotation.from_matrix(turns.reshape(-1, 3, 3)).as_rotvec().reshape(-1, N_JOINTS, 3)
    residual_mm = dict(zip(labels, np.round(off_mm, 1).tolist(), strict=True))
    betas = np.pad(skin.betas, (0, body.shapedirs.shape[-1] - len(skin.betas)))
    return FittedBody(betas, rotvecs, roots_m - skin.joints_m[0], residual_mm)


@dataclass(frozen=True, eq=False)
class _Placed:
    """Joints and N markers in T frames."""

    world: NDArray[np.float64]
    """(T, 22, 3, 3) turns of joints in the world."""
    joints_m: NDArray[np.float64]
    """(T, 22, 3)."""
    carried_m: NDArray[np.float64]
    """(T, N, 22, 3) each joint's part of where a marker is."""

    @property
    def places_m(self) -> NDArray[np.float64]:
        """(T, N, 3) of the markers."""
        return self.carried_m.sum(axis=2)


class _Skin:
    """Markers on a body's skin: what is sought for all frames, and where they are in each."""

    def __init__(self, body: BodyModelData, vertices: NDArray[np.intp]) -> None:
        self.body, count = body, min(N_BETAS, body.shapedirs.shape[-1])
        self.betas, self.moved_m = np.zeros(count), np.zeros((len(vertices), 3))
        normals = vertex_normals(body.v_template, body.faces)[vertices]
        self._template_m = body.v_template[vertices] + _STANDOFF_M * normals
        self._shapes = body.shapedirs[vertices][..., :count]  # (N, 3, S)
        none_m = shaped_joints(body, np.zeros((1, count)))[0, :N_JOINTS]
        each_m = shaped_joints(body, np.eye(count))[:, :N_JOINTS]
        self._joints_m, self._joint_shapes = none_m, (each_m - none_m).transpose(1, 2, 0)
        # Hands and face follow their wrist and head.
        self.weights = body.body_weights[vertices][:, :N_JOINTS]
        self._by_bends = body.posedirs[vertices][..., : 9 * (N_JOINTS - 1)]
        self._parents = body.parents[:N_JOINTS]
        self._below = np.eye(N_JOINTS)
        for joint in range(N_JOINTS - 1, 0, -1):
            self._below[self._parents[joint]] += self._below[joint]

    @property
    def joints_m(self) -> NDArray[np.float64]:
        """(22, 3) at rest."""
        return self._joints_m + self._joint_shapes @ self.betas

    @property
    def rest_m(self) -> NDArray[np.float64]:
        """(N, 3) markers at rest."""
        return self._template_m + self._shapes @ self.betas + self.moved_m

    def step(self, change: NDArray) -> None:
        """Change betas and places."""
        count = len(self.betas)
        self.betas = np.clip(self.betas + change[:count], -4, 4)
        self.moved_m = self.moved_m + change[count:].reshape(-1, 3)

    def places(self, turns: NDArray, roots_m: NDArray) -> _Placed:
        """Of joints that are turned by (T, 22, 3, 3) about a root joint at (T, 3)."""
        rest = self.rest_m + np.einsum("ncp,tp->tnc", self._by_bends, pose_features(turns))
        world, at = self._chain(turns, roots_m[..., None], self.joints_m[..., None])
        inside = rest[:, :, None] - self.joints_m  # (T, N, J, 3)
        carried = (world[:, None] @ inside[..., None] + at[:, None])[..., 0]
        return _Placed(world, at[..., 0], carried * self.weights[..., None])

    def _chain(
        self, turns: NDArray, roots: NDArray, rest: NDArray
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Turns (T, 22, 3, 3) and places (T, 22, 3, K) in the world of K sets of joints at rest
        (22, 3, K)."""
        world, at = turns.copy(), np.empty((*turns.shape[:2], *rest.shape[1:]))
        at[:, 0] = roots
        for joint, parent in list(enumerate(self._parents))[1:]:
            world[:, joint] = world[:, parent] @ turns[:, joint]
            at[:, joint] = at[:, parent] + world[:, parent] @ (rest[joint] - rest[parent])
        return world, at

    def slopes_by_pose(self, placed: _Placed) -> NDArray[np.float64]:
        """(T, N, 3, 69) by a turn of each joint about its own axes, and by the root's place."""
        levers = np.einsum("kj,tnjx->tnkx", self._below, placed.carried_m, optimize=True)
        levers -= (self.weights @ self._below.T)[..., None] * placed.joints_m[:, None]
        axes = placed.world.swapaxes(2, 3)[:, None]  # (T, 1, J, axis, 3)
        slopes = np.cross(axes, levers[..., None, :])
        out = np.zeros((*levers.shape[:2], 3, 3 * N_JOINTS + 3))
        out[..., :-3] = np.moveaxis(slopes, -1, 2).reshape(*out.shape[:3], -1)
        out[..., -3:] = np.eye(3)
        return out

    def slopes_by_person(self, placed: _Placed, turns: NDArray) -> NDArray[np.float64]:
        """(T, N, 3, S + 3 N) by betas, and by places on the skin."""
        (frames, count), shapes = placed.carried_m.shape[:2], len(self.betas)
        _, at = self._chain(turns, np.zeros(()), self._joint_shapes)
        blended = np.einsum("nj,tjxy->tnxy", self.weights, placed.world)
        out = np.zeros((frames, count, 3, shapes + 3 * count))
        out[..., :shapes] = blended @ self._shapes
        shared = at - placed.world @ self._joint_shapes
        out[..., :shapes] += np.einsum("nj,tjxs->tnxs", self.weights, shared)
        for n in range(count):
            out[:, n, :, shapes + 3 * n : shapes + 3 * n + 3] = blended[:, n]
        return out


def _usual() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(22, 3) of `_USUAL`, means and spreads; a root's is any."""
    means, spreads = np.zeros((N_JOINTS, 3)), np.full((N_JOINTS, 3), np.inf)
    for name, (mean, spread) in _USUAL.items():
        for letter, side in SIDES.items() if "*" in name else [("", "")]:
            row = SMPL_JOINT_NAMES.index(name.replace("*", side))
            mirror = [1, -1, -1] if letter == "R" else [1, 1, 1]
            means[row], spreads[row] = np.array(mean) * mirror, spread
    return means, spreads


_MEANS, _SPREADS = _usual()


def _standing(
    skin: _Skin, points_m: NDArray, trust: NDArray, labels: list[str]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Usual turns (T, 22, 3, 3) and the root's place (T, 3) of bodies whose trunk is where its
    markers are."""
    rows = max(
        ([n for n, label in enumerate(labels) if label in trunk] for trunk in _TRUNK),
        key=lambda each: (len(each) > 2, each == sorted(each)),
    )
    shape = skin.rest_m[rows] - skin.joints_m[0]
    root, places_m = kabsch(points_m[:, rows], shape, trust[:, rows])
    usual = Rotation.from_rotvec(_MEANS).as_matrix()
    turns = np.tile(usual, (len(points_m), 1, 1, 1))
    turns[:, 0] = root
    return turns, places_m


def _fitted(
    skin: _Skin,
    turns: NDArray,
    roots_m: NDArray,
    points_m: NDArray,
    trust: NDArray,
    together: bool = False,
    rounds: int = _ROUNDS,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Turns and roots that bring markers to where they are; `together` with `skin`'s person."""
    width = 3 * N_JOINTS
    stiff = np.r_[_SPREADS.ravel() ** -2.0, np.zeros(3)]
    own = np.full(len(skin.betas) + skin.moved_m.size, 1.0)
    own[len(skin.betas) :] = len(points_m) / 4 / _PLACE_M**2
    for turn in range(rounds):
        now = skin.places(turns, roots_m)
        off, slopes = points_m - now.places_m, skin.slopes_by_pose(now)
        astray = np.linalg.norm(off, axis=2) / _ASTRAY_M if turn > rounds // 3 else 0.0
        weights = (trust / (1 + np.square(astray)) ** 2 / _MARKER_M**2)[..., None, None]
        by_pose = slopes.reshape(len(off), -1, width + 3)
        weighed = (weights * slopes).reshape(by_pose.shape)
        flat = off.reshape(len(off), -1, 1)
        square = by_pose.swapaxes(1, 2) @ weighed + np.diag(stiff + _DAMPING)
        rotvecs = Rotation.from_matrix(turns.reshape(-1, 3, 3)).as_rotvec().reshape(-1, width)
        pull = weighed.swapaxes(1, 2) @ flat
        pull[:, :width, 0] -= stiff[:width] * (rotvecs - _MEANS.ravel())
        if together:
            by_person = skin.slopes_by_person(now, turns)
            weighed_person = (weights * by_person).reshape(len(off), -1, len(own))
            by_person = by_person.reshape(weighed_person.shape)
            across = weighed.swapaxes(1, 2) @ by_person
            solved = np.linalg.solve(square, np.concatenate([across, pull], axis=2))
            whole = (by_person.swapaxes(1, 2) @ weighed_person).sum(axis=0) + np.diag(own)
            whole -= (across.swapaxes(1, 2) @ solved[..., :-1]).sum(axis=0)
            wanted = (weighed_person.swapaxes(1, 2) @ flat).sum(axis=0)[:, 0]
            wanted -= (across.swapaxes(1, 2) @ solved[..., -1:]).sum(axis=0)[:, 0]
            wanted -= own * np.r_[skin.betas, skin.moved_m.ravel()]
            change = np.linalg.solve(whole, wanted)
            skin.step(change)
            steps = solved[..., -1] - solved[..., :-1] @ change
        else:
            steps = np.linalg.solve(square, pull)[..., 0]
        by = np.clip(steps[:, :width], -_LONGEST_RAD, _LONGEST_RAD).reshape(-1, 3)
        turns = turns @ Rotation.from_rotvec(by).as_matrix().reshape(turns.shape)
        roots_m = roots_m + steps[:, width:]
    return turns, roots_m
