"""Reads one FBX by `ufbx`, in a process of its own, for `bridge.motion.readers.fbx`.

The binding (0.0.5, and its source of June 2026) gives objects that it has given before without
counting it: Python frees them, and the interpreter crashes at the third look at a node. Here
whatever it gives is kept, nothing is collected, and the process ends without tidying up.

Local transforms are ufbx's, with pivots, pre-rotations, orders of rotation and layers of animation;
scales are made to pass on to children as matrices do, so that products of these are the world's.
"""

from __future__ import annotations

import gc
import json
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import ufbx
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.errors import DsnetError
from bridge.motion.readers.nodes import (
    USUAL_HZ,
    NodeTree,
    find_person,
    rate_of,
    rest_of_all,
    sampled_times,
    taken,
)
from bridge.motion.skeletons import unusable

_RATES_HZ = 1.0, 1000.0
_SAME_WORLD = 1e-4
_SHORTEST_S = 0.1
_UP = {ufbx.CoordinateAxis.POSITIVE_Y: "y", ufbx.CoordinateAxis.POSITIVE_Z: "z"}
_MOVED = ("Lcl Translation", "Lcl Rotation", "Lcl Scaling")
_KEPT: list[Any] = []


def main(path: Path, joint_map: dict[str, str], out: Path) -> None:
    """Write the person's motion, or the line that refuses the file, to an `.npz`."""
    try:
        data = path.read_bytes()
        scene = kept(
            ufbx.load_memory(
                data,
                ignore_geometry=True,
                ignore_embedded=True,
                inherit_mode_handling=ufbx.InheritModeHandling.COMPENSATE,
            )
        )
        with np.errstate(over="ignore", invalid="ignore"):
            arrays = _read(path, scene, joint_map)
    except DsnetError as error:
        arrays = {"refused": [error.received, error.expected, error.remedy]}
    except ufbx.UfbxError as error:
        arrays = {"damaged": str(error)[:200] or type(error).__name__}
    with out.open("wb") as file:
        np.savez(
            file, allow_pickle=False, **{name: np.array(array) for name, array in arrays.items()}
        )


def kept(given: Any) -> Any:
    """The same, for as long as the process lasts."""
    _KEPT.append(given)
    return given


def each(given: Any) -> list[Any]:
    return [kept(one) for one in kept(given)]


def _read(path: Path, scene: Any, joint_map: dict[str, str]) -> dict[str, Any]:
    nodes = each(scene.nodes)
    tree = _tree(path, scene, nodes)
    person = find_person(tree, joint_map)
    needed = sorted({node for joint in person.nodes for node in (joint, *tree.above(joint))})
    elements = {nodes[node].element_id: node for node in needed}
    takes = [_take(path, stack, elements) for stack in each(scene.anim_stacks)]
    takes = [take for take in takes if take.nodes]
    if not takes:
        raise unusable(path, "which moves no joint", "Export it with its animation.")
    take = max(takes, key=lambda take: take.end_s - take.begin_s)
    usual = scene.settings.frames_per_second
    usual = usual if _RATES_HZ[0] <= usual <= _RATES_HZ[1] else USUAL_HZ
    fps = rate_of(np.array(take.keys_s), usual)
    times_s = sampled_times(path, take.begin_s, take.end_s, fps)
    world: dict[int, NDArray[np.float64]] = {}
    for node in needed:
        times = times_s if node in take.nodes else times_s[:1]
        local = _matrices([ufbx.evaluate_transform(take.anim, nodes[node], t) for t in times])
        parent = tree.parents[node]
        world[node] = world[parent] @ local if parent >= 0 else local
    count = (len(times_s), 4, 4)
    notes = [taken(tree, take.name, [one.name for one in takes if one is not take], fps)]
    return {
        "names": tree.names,
        "parents": tree.parents,
        "rest": tree.rest,
        "nodes": person.nodes,
        "joint_map": json.dumps(dict(person.joint_map)),
        "world": np.stack([np.broadcast_to(world[node], count) for node in person.nodes], axis=1),
        "fps": fps,
        "notes": [*person.notes, *notes, *take.notes],
        "up": _UP.get(kept(scene.settings.axes).up, ""),
    }


def _tree(path: Path, scene: Any, nodes: list[Any]) -> NodeTree:
    numbers = {node.element_id: number for number, node in enumerate(nodes)}
    parents = [numbers[kept(node.parent).element_id] if n else -1 for n, node in enumerate(nodes)]
    default = np.array([_square(node.node_to_world) for node in nodes])
    local = _matrices([kept(node.local_transform) for node in nodes])
    products = default[parents[1:]] @ local[1:]
    if np.abs(products - default[1:]).max(initial=0) > _SAME_WORLD * np.abs(default).max():
        raise unusable(
            path, "whose bones inherit scales in a way that is not read", "Apply all scales first."
        )
    bind = dict[int, NDArray[np.float64]]()
    for pose in (pose for pose in each(scene.poses) if pose.is_bind_pose):
        for bone in each(pose.bone_poses):
            bind[numbers[kept(bone.bone_node).element_id]] = _square(bone.bone_to_world)
    bound = set[int]()
    for skin in sorted(each(scene.skin_deformers), key=lambda skin: len(kept(skin.clusters))):
        for cluster in each(skin.clusters):
            if bone := kept(cluster.bone_node):
                bound.add(number := numbers[bone.element_id])
                bind[number] = _square(cluster.bind_to_world)
    kinds = [kept(node.attrib_type) for node in nodes]
    bones = bound | {n for n, kind in enumerate(kinds) if kind == ufbx.ElementType.BONE}
    bones = bones or {n for n, kind in enumerate(kinds) if kind == ufbx.ElementType.EMPTY}
    bind = {number: at for number, at in bind.items() if number in bones}
    return NodeTree(
        path=path,
        names=tuple(node.name or "scene" for node in nodes),
        parents=tuple(parents),
        joints=tuple(sorted(bones)),
        rest=rest_of_all(parents, default, bind),
        is_bound=bool(bind),
        rest_is="the bind pose" if bind else "as the bones stand without it",
    )


@dataclass(frozen=True, eq=False)
class _Take:
    """One take, and when it moves which of some nodes."""

    name: str
    anim: Any
    nodes: frozenset[int] = frozenset()
    begin_s: float = 0.0
    end_s: float = 0.0
    keys_s: tuple[float, ...] = ()
    """Of the curve with most of them."""
    notes: tuple[str, ...] = ()


def _take(path: Path, stack: Any, needed: Mapping[int, int]) -> _Take:
    """Of nodes by number of their element."""
    moved, curves = set[int](), list[Any]()
    for layer in each(stack.layers):
        for prop in each(layer.anim_props):
            node = needed.get(kept(prop.element).element_id)
            if node is not None and prop.prop_name in _MOVED:
                of_axes = [curve for curve in each(kept(prop.anim_value).curves) if curve]
                curves += [c for c in of_axes if len(kept(c.keyframes))]
                moved |= {node} if of_axes else set()
    if not curves:
        return _Take(stack.name, None)
    keys = kept(max((kept(curve.keyframes) for curve in curves), key=len))
    begin, end = min(c.min_time for c in curves), max(c.max_time for c in curves)
    first, last = max(begin, stack.time_begin), min(end, stack.time_end)
    notes = ()
    if last - first < _SHORTEST_S <= end - begin:
        first, last = begin, end
    elif max(first - begin, end - last) > _SHORTEST_S:
        told = f"{path}: keys from {begin:.2f} to {end:.2f} s, of which the take is"
        notes = (f"{told} {first:.2f} to {last:.2f} s: others are left out",)
    anim, times = kept(stack.anim), tuple(key.time for key in keys)
    return _Take(stack.name, anim, frozenset(moved), first, last, times, notes)


def _matrices(transforms: Sequence[Any]) -> NDArray[np.float64]:
    """(T, 4, 4) of translations, quaternions and scales."""
    found = np.tile(np.eye(4), (len(transforms), 1, 1))
    turns = Rotation.from_quat([one.rotation for one in transforms]).as_matrix()
    found[:, :3, :3] = turns * np.array([one.scale for one in transforms])[:, None]
    found[:, :3, 3] = [one.translation for one in transforms]
    return found


def _square(columns: Any) -> NDArray[np.float64]:
    """(4, 4) of ufbx's four columns of three numbers."""
    found = np.eye(4)
    found[:3] = np.array(kept(columns)).T
    return found


if __name__ == "__main__":
    gc.disable()
    main(Path(sys.argv[1]), json.loads(sys.argv[2]), Path(sys.argv[3]))
    os._exit(0)
