"""What a scene of Blender holds, as arrays: an armature in every frame, and a mesh at rest."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.paper import N_BETAS
from dsnet.blender.rest_mesh import SceneMesh
from dsnet.blender.scene_motion import SceneArmature

OF = "soft_tissue_of"
"""Property of a body that was put beside an armature: which."""
_FACTS = "dsnet"
"""Property of a mesh that `dsnet export` wrote: see `dsnet.exporters.glb`."""
_OF_SHAPE = ("shape", "exp")
"""How names of SMPL add-ons' shape keys begin that make a person, and not a pose."""


def chosen(selected: Any) -> tuple[Any, Any]:
    """The armature of what is selected, and the mesh of SMPL's family; None where a body of its
    own is put beside the armature."""
    if selected is None or selected.type not in ("ARMATURE", "MESH"):
        received = "nothing" if selected is None else f"{selected.name}, of type {selected.type}"
        raise DsnetError(
            f"{received} selected", "an armature, or a mesh that one moves", "Select one of these."
        )
    if selected.type == "ARMATURE":
        return selected, None
    if (beside := selected.get(OF)) is not None:
        return beside, None
    armature = selected.find_armature()
    if armature is None:
        raise DsnetError(
            f"{selected.name}, which no armature moves",
            "a mesh with an Armature modifier or parent",
            "Select the armature of its motion; a point cache has its flesh already.",
        )
    facts = selected.data.get(_FACTS)
    if facts is not None and facts.get("flesh"):
        raise DsnetError(
            f"{selected.name}, which holds the soft tissue of dsnet export",
            "a mesh without",
            "Export it with --gain 0, or select its armature.",
        )
    return armature, selected


def rate_of(scene: Any) -> float:
    """Frames a second."""
    return scene.render.fps / scene.render.fps_base


def armature_at_rest(thing: Any, fps: float) -> SceneArmature:
    """The bones, with no frame."""
    bones = [*thing.data.bones]  # parents come first
    numbers = {bone.name: number for number, bone in enumerate(bones)}
    rest = [np.array(thing.matrix_world @ bone.matrix_local) for bone in bones]
    return SceneArmature(
        name=thing.name,
        bones=tuple(numbers),
        parents=tuple(-1 if bone.parent is None else numbers[bone.parent.name] for bone in bones),
        rest=np.reshape(rest, (-1, 4, 4)).astype(np.float64),
        world=np.zeros((0, len(bones), 4, 4)),
        fps=fps,
    )


def frames_of(scene: Any, thing: Any, names: tuple[str, ...]) -> Iterator[NDArray[np.float64]]:
    """(B, 4, 4) the bones in the world in each frame of the scene's range, as constraints, drivers
    and actions have them. The scene is where it was at the end."""
    here = scene.frame_current, scene.frame_subframe
    try:
        for frame in range(scene.frame_start, scene.frame_end + 1):
            scene.frame_set(frame)
            bones, to_world = thing.pose.bones, thing.matrix_world
            yield np.array([to_world @ bones[name].matrix for name in names])
    finally:
        scene.frame_set(here[0], subframe=here[1])


def mesh_at_rest(thing: Any, bones: tuple[str, ...]) -> SceneMesh:
    """Vertices with the person's shape, triangles and weights; copies at seams are left out."""
    mesh = thing.data
    of_body = body_vertices(mesh)
    own = slice(int(of_body.max(initial=-1)) + 1)
    vertices = _shaped(mesh)[own]
    to_world = np.array(thing.matrix_world)
    mesh.calc_loop_triangles()
    faces = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("vertices", faces)
    of_group = {group.index: group.name for group in thing.vertex_groups}
    columns = {name: number for number, name in enumerate(bones)}
    weights = np.zeros((len(mesh.vertices), len(bones)))
    for number, vertex in enumerate(mesh.vertices):
        for one in vertex.groups:
            column = columns.get(of_group.get(one.group, ""))
            if column is not None:
                weights[number, column] = one.weight
    return SceneMesh(
        name=thing.name,
        vertices=vertices @ to_world[:3, :3].T + to_world[:3, 3],
        faces=of_body[faces.reshape(-1, 3)],
        weights=weights[own],
        betas=_betas_of(thing),
    )


def body_vertices(mesh: Any) -> NDArray[np.int64]:
    """(N,) which of the body's vertices each of the mesh's is: those at seams of the texture of a
    file that `dsnet export` wrote are there several times, the copies last."""
    facts, count = mesh.get(_FACTS), len(mesh.vertices)
    copies = [] if facts is None else [int(one) for one in facts.get("copies_of", [])]
    own = count - len(copies)
    if own < 0 or not all(0 <= one < own for one in copies):  # another mesh has the property now
        return np.arange(count)
    return np.array([*range(own), *copies], np.int64)


def _shaped(mesh: Any) -> NDArray[np.float64]:
    """(V, 3) in the mesh's space."""
    if mesh.shape_keys is None:
        return _places(mesh.vertices)
    keys = mesh.shape_keys.key_blocks
    basis = _places(keys[0].data)
    shaped = basis.copy()
    for key in keys[1:]:
        if key.name.lower().startswith(_OF_SHAPE) and not key.mute and "_plus" not in key.name:
            shaped += key.value * (_places(key.data) - basis)
    return shaped


def _places(points: Any) -> NDArray[np.float64]:
    found = np.empty(3 * len(points), np.float32)
    points.foreach_get("co", found)
    return found.reshape(-1, 3).astype(np.float64)


def _betas_of(thing: Any) -> NDArray[np.float64] | None:
    facts = thing.data.get(_FACTS)
    given = None if facts is None else facts.get("betas")
    if given is None or len(given) != N_BETAS:
        return None
    betas = np.array([*given], np.float64)
    return betas if np.isfinite(betas).all() else None
