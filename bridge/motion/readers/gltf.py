"""glTF, GLB, VRM and VRMA: the longest animation, of the joints of one person.

At rest the joints lie as the skin binds them. Where there is no skin, and in VRM, whose rest is a
T, they lie as the nodes stand. Meshes and pictures are not read.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from bridge.motion.motion import AS_IT_SAYS, HowRead, Motion
from bridge.motion.readers.gltf_files import GltfFile, channels
from bridge.motion.readers.nodes import (
    NodeTree,
    Person,
    find_person,
    followed,
    moving,
    rate_of,
    rest_of_all,
    sampled_times,
    taken,
)
from bridge.motion.skeletons import SkeletonMotion, unusable
from bridge.runs.untrusted import file_refused

_AGAIN = "Export it again, as GLB."
_NONE = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}


def read(path: Path, how: HowRead = AS_IT_SAYS) -> Motion:
    """Read one file; y is up, as the format has it, unless the user says otherwise."""
    with file_refused(path, unusable, _AGAIN), np.errstate(over="ignore", invalid="ignore"):
        file = GltfFile.opened(path)
        if not file.animations:
            raise unusable(path, "which holds no animation", "Export it with its animation.")
        tree, place = _tree(file)
        person = find_person(tree, how.joint_map)
        skeleton = _moving(file, tree, place, person)
    return followed(skeleton, person, how, "y")


def gender_of(path: Path) -> str | None:
    """`unknown` of a file with an animation; None of a model alone."""
    with file_refused(path, unusable, _AGAIN):
        return "unknown" if GltfFile.opened(path).animations else None


def _tree(file: GltfFile) -> tuple[NodeTree, dict[int, int]]:
    """The nodes below one that is above all, and the place of each; ValueError if they are none."""
    nodes, above = file.list("nodes"), dict[int, int]()
    for number, node in enumerate(nodes):
        for child in node.get("children", []):
            if child in above:
                raise ValueError(f"node {child} below two others")
            above[child] = number
    order = [number for number in range(len(nodes)) if number not in above]
    for number in order:  # which grows
        order += nodes[number].get("children", [])
    if sorted(order) != [*range(len(nodes))]:
        raise ValueError("nodes below themselves")
    place = {number: n for n, number in enumerate(order, 1)}
    parents = (-1, *(place[above[number]] if number in above else 0 for number in order))
    default = np.tile(np.eye(4), (len(parents), 1, 1))
    for number, n in place.items():
        default[n] = default[parents[n]] @ _local(nodes[number], {}, 1)[0]
    bones = file.humanoid
    joints = bones or {joint for skin in file.list("skins") for joint in skin["joints"]}
    joints = joints or {n for n, node in enumerate(nodes) if not {"mesh", "camera"} & node.keys()}
    names = (bones.get(n) or str(nodes[n].get("name", f"node {n}")) for n in order)
    bind = {} if bones else _bind(file, place)
    tree = NodeTree(
        path=file.path,
        names=("scene", *names),
        parents=parents,
        joints=tuple(sorted(place[number] for number in joints)),
        rest=rest_of_all(parents, default, bind),
        is_bound=bool(bind),
        rest_is="the skin's" if bind else "as the nodes stand without it",
    )
    return tree, place


def _bind(file: GltfFile, place: Mapping[int, int]) -> dict[int, NDArray[np.float64]]:
    """(4, 4) by joint of the largest skin that says how it is bound, and of others beside it."""
    bind = dict[int, NDArray[np.float64]]()
    for skin in sorted(file.list("skins"), key=lambda skin: len(skin["joints"])):
        if "inverseBindMatrices" in skin:
            inverse = file.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4)
            joints = [place[joint] for joint in skin["joints"]]
            # They lie column by column.
            bind |= zip(joints, np.linalg.pinv(inverse.swapaxes(1, 2)), strict=True)
    return bind


@dataclass(frozen=True, eq=False)
class _Track:
    """Keys of what of a node moves: (K,) seconds and (K, 3 or 4), or (3 K, ...) with tangents."""

    times_s: NDArray[np.float64]
    values: NDArray[np.float64]
    kind: str

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """(T, 3 or 4); before the first key as there, after the last as there."""
        keys, when = self.times_s, times_s.clip(self.times_s[0], self.times_s[-1])
        if len(keys) == 1 or self.kind == "STEP":
            values = self.values[1::3] if self.kind == "CUBICSPLINE" else self.values
            return values[np.searchsorted(keys, when + 1e-6, side="right").clip(1) - 1]
        if self.kind == "CUBICSPLINE":
            return self._spline(when)
        if self.values.shape[1] == 4:
            return Slerp(keys, Rotation.from_quat(self.values))(when).as_quat()
        return np.stack([np.interp(when, keys, values) for values in self.values.T], axis=1)

    def _spline(self, when: NDArray[np.float64]) -> NDArray[np.float64]:
        """By each key's tangents before and after it."""
        before, values, after = self.values[0::3], self.values[1::3], self.values[2::3]
        first = np.searchsorted(self.times_s, when, side="right").clip(1, len(values) - 1) - 1
        step = np.diff(self.times_s)[first][:, None]
        t = (when - self.times_s[first])[:, None] / step
        start, end = 2 * t**3 - 3 * t**2 + 1, 3 * t**2 - 2 * t**3
        leaving, arriving = t**3 - 2 * t**2 + t, t**3 - t**2
        return (
            start * values[first] + step * leaving * after[first]
            + end * values[first + 1] + step * arriving * before[first + 1]
        )  # fmt: skip


class _Take:
    """One animation: what it says of some nodes."""

    def __init__(self, file: GltfFile, animation: Mapping[str, Any], nodes: set[int]) -> None:
        self.name = str(animation.get("name", ""))[:80]
        self.tracks: dict[int, dict[str, _Track]] = {node: {} for node in nodes}
        for node, what, number in channels(animation):
            if node in nodes:
                self.tracks[node][what] = _track(file, animation["samplers"][number])
        every = [track.times_s for tracks in self.tracks.values() for track in tracks.values()]
        self.keys_s = max(every, key=len, default=np.zeros(0))
        ends = [(times[0], times[-1]) for times in every] or [(0.0, 0.0)]
        self.begin_s, self.end_s = min(begin for begin, _ in ends), max(end for _, end in ends)


def _track(file: GltfFile, sampler: Mapping[str, Any]) -> _Track:
    times, values = file.array(sampler["input"])[:, 0], file.array(sampler["output"])
    kind = sampler.get("interpolation", "LINEAR")
    if not len(times) or not (np.diff(times) > 0).all():
        raise ValueError("keys that do not follow one another")
    if len(values) != len(times) * (3 if kind == "CUBICSPLINE" else 1):
        raise ValueError(f"{len(values)} values at {len(times)} keys")
    return _Track(times, values, kind)


def _moving(
    file: GltfFile, tree: NodeTree, place: Mapping[int, int], person: Person
) -> SkeletonMotion:
    """The longest animation of the person's nodes, at the rate of its keys."""
    needed = {node for joint in person.nodes for node in (joint, *tree.above(joint))}
    nodes = {number for number, node in place.items() if node in needed}
    takes = [_Take(file, animation, nodes) for animation in file.animations]
    take = max(takes, key=lambda take: (take.end_s - take.begin_s, len(take.keys_s)))
    if not len(take.keys_s):
        raise unusable(file.path, "which moves no joint", "Export it with its animation.")
    fps = rate_of(take.keys_s)
    times_s = sampled_times(file.path, take.begin_s, take.end_s, fps)
    world = {0: np.broadcast_to(np.eye(4), (len(times_s), 4, 4))}
    for number, node in place.items():
        if number in nodes:
            moved = {what: track.at(times_s) for what, track in take.tracks[number].items()}
            local = _local(file.list("nodes")[number], moved, len(times_s))
            world[node] = world[tree.parents[node]] @ local
    told = taken(tree, take.name, [one.name for one in takes if one is not take], fps)
    of_joints = np.stack([world[node] for node in person.nodes], axis=1)
    return moving(tree, person, of_joints, fps, [told])


def _local(
    node: Mapping[str, Any], moved: Mapping[str, NDArray[np.float64]], count: int
) -> NDArray[np.float64]:
    """(T, 4, 4) from a node's frame to its parent's; of what moves, (T, 3 or 4) are given."""
    if "matrix" in node and not moved:
        matrix = np.array(node["matrix"], np.float64).reshape(4, 4).T
        return np.tile(matrix, (count, 1, 1))
    parts = {
        name: moved.get(name, np.tile(np.array(node.get(name, none), np.float64), (count, 1)))
        for name, none in _NONE.items()
    }
    if not all(np.isfinite(part).all() for part in parts.values()):
        raise ValueError("numbers that are not all finite")
    local = np.tile(np.eye(4), (count, 1, 1))
    turns = Rotation.from_quat(parts["rotation"]).as_matrix()
    local[:, :3, :3] = turns * parts["scale"][:, None]
    local[:, :3, 3] = parts["translation"]
    return local
