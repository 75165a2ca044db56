"""Nodes that move, as FBX and glTF have them: one person's joints among them, and how they turn.

A joint's turn is the one from the rest pose, in the file's world: how a program lays the frames of
its bones (Blender along y, Maya along x) makes no difference.
"""

from __future__ import annotations

import warnings
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.errors import DsnetError
from bridge.motion.directions import angle_deg, unit
from bridge.motion.motion import MOST_FRAMES, HowRead, Motion, UpAxis
from bridge.motion.retargeting import retargeted
from bridge.motion.skeletons import SIDES, SkeletonMotion, joints_by_name, unusable

_NEAR_RATE = 5e-4
"""Of a rate, by which one of rounded times may be off a whole number."""
USUAL_HZ = 60.0
"""Where a file states none."""
_SPARSE_HZ = 20.0
"""Keys farther apart are not one a frame."""
_MISSING = 0.2
"""Of keys: where more lie farther apart than usual, a program has left out what it could."""
_MOST_HZ = 1000.0
_AXES = "XYZ"
_MOVED = 1e-5
"""Of the skeleton's size: by more a bone is another than at rest."""


_BONES = (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"))
_ALIKE_DEG, _STRAIGHT_DEG, _SAME_DEG = 5.0, 20.0, 0.5


@dataclass(frozen=True, eq=False)
class NodeTree:
    """All N nodes of a file, parents first; the first is the one root of all."""

    path: Path
    names: tuple[str, ...]
    parents: tuple[int, ...]
    joints: tuple[int, ...]
    """Those that the file calls joints, or all that may be, in order."""
    rest: NDArray[np.float64]
    """(N, 4, 4) from each node's frame to the world, at rest."""
    rest_is: str
    """Where the file has its rest pose from, in words."""
    is_bound: bool = False
    """Whether a skin or a bind pose says how the joints rest. Else a program may have written how
    they stood when the file was made."""

    def above(self, node: int) -> list[int]:
        """The nodes from a node's parent to the root."""
        found = []
        while (node := self.parents[node]) >= 0:
            found.append(node)
        return found


@dataclass(frozen=True)
class Person:
    """Whose motion is read."""

    nodes: tuple[int, ...]
    """The joints that SMPL has, and those above them, parents first."""
    joint_map: Mapping[str, str]
    """The names of SMPL's joints in the file, by SMPL's."""
    notes: tuple[str, ...]


def find_person(tree: NodeTree, joint_map: Mapping[str, str]) -> Person:
    """The first skeleton that is a person's; where none is alone, all joints together are tried."""
    if not tree.joints:
        raise unusable(tree.path, "which has no skeleton", "Export it with its bones.")
    skeletons: dict[int, list[int]] = defaultdict(list)
    joints = set(tree.joints)
    for joint in tree.joints:
        skeletons[[joint, *(node for node in tree.above(joint) if node in joints)][-1]].append(
            joint
        )
    people = {}
    for root, members in skeletons.items():
        try:
            people[root] = _person(tree, members, joint_map)
        except DsnetError:
            continue
    if not people:
        every = {node for joint in joints for node in (joint, *tree.above(joint))}
        return _person(tree, sorted(every), joint_map)
    first, *others = people
    if not others:
        return people[first]
    names = ", ".join(tree.names[root] for root in others)[:100]
    told = f"{tree.path} holds {len(people)} people: the first is read, not that of {names}"
    return replace(people[first], notes=(told,))


def _person(tree: NodeTree, members: Sequence[int], joint_map: Mapping[str, str]) -> Person:
    """DsnetError if these nodes are none."""
    still = _skeleton(tree, members, tree.rest[None, list(members)], 1.0)
    found = joints_by_name(still, joint_map)
    if not tree.is_bound and not _may_be_rest({n: still.rest[joint] for n, joint in found.items()}):
        raise unusable(
            tree.path,
            "which has no bind pose, and without its animation its joints stand as nobody rests",
            "Export it with its mesh, or with a T-pose as rest pose.",
        )
    mapped = {members[number] for number in found.values()}
    kept = mapped | {node for joint in mapped for node in tree.above(joint)}
    names = {name: still.names[number] for name, number in found.items()}
    return Person(tuple(node for node in members if node in kept), names, ())


def _may_be_rest(places: Mapping[str, NDArray[np.float64]]) -> bool:
    """Whether left and right are alike, and the knees nearly straight."""
    sides = [
        {name: unit(places[f"{side}_{end}"] - places[f"{side}_{name}"]) for name, end in _BONES}
        for side in SIDES
    ]
    across = unit(
        sum((places[f"left_{n}"] - places[f"right_{n}"] for n in ("hip", "shoulder")), np.zeros(3))
    )
    left, right = sides
    mirrored = {name: bone - 2 * (bone @ across) * across for name, bone in right.items()}
    return all(angle_deg(left[name], mirrored[name]) < _ALIKE_DEG for name, _ in _BONES) and all(
        angle_deg(side["hip"], side["knee"]) < _STRAIGHT_DEG for side in sides
    )


def moving(
    tree: NodeTree, person: Person, world: NDArray[np.float64], fps: float, notes: Sequence[str]
) -> SkeletonMotion:
    """The person's motion of (T, K, 4, 4) from the frames of its K nodes to the world."""
    skeleton, told = _skeleton(tree, person.nodes, world, fps), [*person.notes, *notes]
    if not tree.is_bound and _is_a_frame(skeleton):
        told.append(
            f"{tree.path} has no bind pose, and without its animation its joints stand as in one "
            "of its frames: trunk, collars and feet are off by as much as they are turned there"
        )
    return replace(skeleton, notes=tuple(told))


def _is_a_frame(skeleton: SkeletonMotion) -> bool:
    """Whether some frame of several has all joints as at rest."""
    turned = Rotation.from_euler(_AXES, skeleton.angles_rad.reshape(-1, 3)).magnitude()
    most = turned.reshape(skeleton.angles_rad.shape[:2])[:, 1:].max(axis=1, initial=0)
    return bool(most.min() < np.radians(_SAME_DEG) < most.max())


def followed(
    skeleton: SkeletonMotion, person: Person, how: HowRead, stated_up: UpAxis | None
) -> Motion:
    """The motion as SMPL's joints do it; the vertical is the user's, or else the file's."""
    up = stated_up if stated_up and how.up == "auto" else how.up
    return retargeted(skeleton, replace(how, up=up, joint_map=person.joint_map))


def taken(tree: NodeTree, take: str, others: Sequence[str], fps: float) -> str:
    """The line that says what of the file is read."""
    names = ", ".join(others)[:100]
    choice = f"{take!r}, the longest animation (not {names})," if others else "its animation"
    rest = f"its rest pose is {tree.rest_is}"
    return f"{tree.path}: {choice} is sampled at {fps:g} frames a second; {rest}"


def _skeleton(
    tree: NodeTree, nodes: Sequence[int], world: NDArray[np.float64], fps: float
) -> SkeletonMotion:
    if not np.isfinite(world).all() or not np.isfinite(tree.rest[list(nodes)]).all():
        raise unusable(tree.path, "whose numbers are not all finite", "Export it again.")
    numbers = {node: number for number, node in enumerate(nodes)}
    parents = [
        next((numbers[above] for above in tree.above(node) if above in numbers), -1)
        for node in nodes
    ]
    rest = tree.rest[list(nodes)]
    turns = _rotations(tree.path, world[..., :3, :3] @ np.linalg.pinv(rest[:, :3, :3]))
    places, rest_places = world[..., :3, 3], rest[:, :3, 3]
    below = [number for number, parent in enumerate(parents) if parent >= 0]
    over = [parents[number] for number in below]
    bones, rest_bones = places[:, below] - places[:, over], rest_places[below] - rest_places[over]
    # A bind pose may be in another unit than the scene; a bone may be a way from the origin.
    lengths = np.linalg.norm(rest_bones, axis=-1)
    size, long = lengths.sum(), lengths > _MOVED * lengths.sum()
    ratios = np.median(np.linalg.norm(bones[:, long], axis=-1), axis=0) / lengths[long]
    scale = np.median(ratios) if long.any() else 1.0
    rest_places, rest_bones = scale * rest_places, scale * rest_bones
    above = np.swapaxes(turns[:, over], -1, -2)
    bones = np.einsum("tjxy,tjy->tjx", above, bones)
    local = turns.copy()
    local[:, below] = above @ turns[:, below]
    moves = np.abs(bones - rest_bones).max(axis=(0, 2), initial=0) > _MOVED * scale * size
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Gimbal lock")  # what comes is a rotation all the same
        angles = Rotation.from_matrix(local.reshape(-1, 3, 3)).as_euler(_AXES)
    return SkeletonMotion(
        path=tree.path,
        names=tuple(tree.names[node] for node in nodes),
        parents=tuple(parents),
        rest=rest_places,
        axes=(_AXES,) * len(nodes),
        angles_rad=angles.reshape(*local.shape[:2], 3),
        root=places[:, 0],
        places={below[n]: bones[:, n] for n in np.flatnonzero(moves)},
        fps=fps,
    )


def _rotations(path: Path, matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """The nearest rotations (..., 3, 3): bones may be scaled, and so is the world of others."""
    if (np.linalg.det(matrices) < 0).mean() > 0.5:
        raise unusable(path, "which is mirrored against its rest pose", "Apply its scale first.")
    one, _, other = np.linalg.svd(matrices)
    one[..., -1] *= np.sign(np.linalg.det(one) * np.linalg.det(other))[..., None]
    return one @ other


def rest_of_all(
    parents: Sequence[int], default: NDArray[np.float64], bind: Mapping[int, NDArray[np.float64]]
) -> NDArray[np.float64]:
    """(N, 4, 4) rest of all nodes: where `bind` has none, as by default beside one that it has.

    The bind pose may lie in another world than that of the default transforms (N, 4, 4).
    """
    rest, moved = default.copy(), np.eye(4)
    inverse = np.linalg.pinv(default)
    if bind:
        first = min(bind)
        moved = bind[first] @ inverse[first]
    for node, parent in enumerate(parents):
        if node in bind:
            rest[node] = bind[node]
        elif parent < 0:
            rest[node] = moved @ default[node]
        else:
            rest[node] = rest[parent] @ inverse[parent] @ default[node]
    return rest


def rate_of(times_s: NDArray[np.floating], usual: float = USUAL_HZ) -> float:
    """Frames a second of keys that lie one a frame; the usual ones where they do not."""
    steps = np.diff(np.unique(np.round(times_s, 6)))
    step = float(np.median(steps)) if len(steps) else np.inf
    if not 1 / _MOST_HZ <= step <= 1 / _SPARSE_HZ or (steps > 1.1 * step).mean() > _MISSING:
        return usual
    fps = 1 / step
    near = round(fps)
    return float(near) if abs(fps - near) < _NEAR_RATE * near else fps


def sampled_times(path: Path, begin_s: float, end_s: float, fps: float) -> NDArray[np.float64]:
    """(T,) seconds, from the first to the last."""
    count = int((end_s - begin_s) * fps + 1e-3) + 1
    if count > MOST_FRAMES:
        raise unusable(path, f"with more than {MOST_FRAMES} frames", "Cut it into several files.")
    return begin_s + np.arange(count) / fps
