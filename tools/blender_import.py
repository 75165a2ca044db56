"""Import a moving body into Blender and save what stands there: runs in Blender's own Python.

    python tools/blender_import.py JOB

JOB is JSON, written by `tools.try_blender` from the steps that `docs/export.md` tells: `how` to
import `path` at which `frames`, at what rate `fps`, and the `.npz` for what is seen, `out`; for a
cache its `base` mesh, `time_mode` and `turn_deg`; for meshes the two `axes`, forward and up; for a
skeleton its `joints`, whose places stand for vertices.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import bpy  # pyright: ignore[reportMissingImports]
import numpy as np

Seen = dict[str, np.ndarray]


def main(job: dict[str, Any]) -> None:
    """Do one job, and write its arrays to the `.npz` that it names."""
    if job["how"] == "write":
        write(job)
        return
    ways = {"usd": usd, "glb": glb, "abc": abc, "cache": cache, "single": single, "bvh": bvh}
    frames = list(ways[job["how"]](job))
    scene, bones = bpy.context.scene, [len(armature.bones) for armature in bpy.data.armatures]
    every: dict[str, Any] = {key: [frame[key] for frame in frames] for key in frames[0]}
    np.savez(job["out"], range=[scene.frame_start, scene.frame_end], bones=bones, **every)


def usd(job: dict[str, Any]) -> Iterator[Seen]:
    """*File > Import > Universal Scene Description*, and the rate by hand."""
    new_scene()
    bpy.ops.wm.usd_import(filepath=job["path"])
    imported_fps = bpy.context.scene.render.fps
    bpy.context.scene.render.fps = job["fps"]
    for seen in evaluated(the_mesh(), job["frames"]):
        yield {**seen, "imported_fps": np.array(imported_fps)}


def glb(job: dict[str, Any]) -> Iterator[Seen]:
    """*File > Import > glTF 2.0*, into a scene of the file's rate."""
    new_scene(job["fps"])
    bpy.ops.import_scene.gltf(filepath=job["path"])
    yield from evaluated(the_mesh(), job["frames"])


def abc(job: dict[str, Any]) -> Iterator[Seen]:
    """*File > Import > Alembic*, into a scene of the file's rate."""
    new_scene(job["fps"])
    bpy.ops.wm.alembic_import(filepath=job["path"])
    yield from evaluated(the_mesh(), job["frames"])


def cache(job: dict[str, Any]) -> Iterator[Seen]:
    """The base mesh, a *Mesh Cache* modifier, and a turn of the object."""
    new_scene(job["fps"])
    import_mesh(job, job["base"])
    body = the_mesh()
    modifier = body.modifiers.new("cache", "MESH_CACHE")
    modifier.cache_format = job["path"].rpartition(".")[2].upper()
    modifier.filepath = str(Path(job["path"]).resolve())
    modifier.time_mode = job["time_mode"]
    body.rotation_euler.x += math.radians(job["turn_deg"])
    yield from evaluated(body, job["frames"])


def single(job: dict[str, Any]) -> Iterator[Seen]:
    """One file a frame, each into an empty scene."""
    for frame in job["frames"]:
        new_scene(job["fps"])
        import_mesh(job, job["path"].format(frame))
        yield from evaluated(the_mesh(), [0])


def bvh(job: dict[str, Any]) -> Iterator[Seen]:
    """*File > Import > Motion Capture*, into a scene of the file's rate."""
    new_scene(job["fps"])
    bpy.ops.import_anim.bvh(filepath=job["path"])
    [skeleton] = [thing for thing in bpy.data.objects if thing.type == "ARMATURE"]
    to_world = np.array(skeleton.matrix_world)
    for frame in job["frames"]:
        bpy.context.scene.frame_set(frame)
        heads = np.array([skeleton.pose.bones[joint].head for joint in job["joints"]])
        yield {"vertices_m": heads @ to_world[:3, :3].T + to_world[:3, 3]}


def write(job: dict[str, Any]) -> None:
    """A BVH as each of the files `out`: its skeleton with a mesh, without which none has a rest."""
    for path in job["out"]:
        new_scene(job["fps"])
        bpy.ops.import_anim.bvh(filepath=job["path"], update_scene_duration=True)
        [skeleton] = [thing for thing in bpy.data.objects if thing.type == "ARMATURE"]
        heads = [bone.head_local for bone in skeleton.data.bones]
        mesh = bpy.data.meshes.new("body")
        ends = [(n, (n + 1) % len(heads), (n + 2) % len(heads)) for n in range(len(heads))]
        mesh.from_pydata(heads, [], ends)
        body = bpy.data.objects.new("body", mesh)
        bpy.context.collection.objects.link(body)
        body.parent, body.matrix_world = skeleton, skeleton.matrix_world
        for number, bone in enumerate(skeleton.data.bones):
            body.vertex_groups.new(name=bone.name).add([number], 1.0, "REPLACE")
        body.modifiers.new("skin", "ARMATURE").object = skeleton
        if path.endswith("fbx"):
            bpy.ops.export_scene.fbx(filepath=path, bake_anim_simplify_factor=0.0)
        else:
            bpy.ops.export_scene.gltf(filepath=path)


def new_scene(fps: int | None = None) -> None:
    """An empty scene as Blender comes, at another rate if one is given."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if fps:
        bpy.context.scene.render.fps = fps


def import_mesh(job: dict[str, Any], path: str) -> None:
    """An OBJ or PLY with the axes that the job names."""
    read = getattr(bpy.ops.wm, f"{path.rpartition('.')[2]}_import")
    forward, up = (axis.replace("-", "NEGATIVE_") for axis in job["axes"])
    read(filepath=path, forward_axis=forward, up_axis=up)


def the_mesh() -> Any:
    """The one object that is a mesh, but for what glTF's importer draws its bones as."""
    armatures = [thing for thing in bpy.data.objects if thing.type == "ARMATURE"]
    drawn = {bone.custom_shape for armature in armatures for bone in armature.pose.bones}
    [body] = [thing for thing in bpy.data.objects if thing.type == "MESH" and thing not in drawn]
    return body


def evaluated(body: Any, frames: Iterable[float]) -> Iterator[Seen]:
    """The body in the world, all modifiers applied, at each frame or fraction of one."""
    for frame in frames:
        bpy.context.scene.frame_set(math.floor(frame), subframe=frame % 1)
        thing = body.evaluated_get(bpy.context.evaluated_depsgraph_get())
        mesh, to_world = thing.to_mesh(), np.array(thing.matrix_world)
        faces = values(mesh.loops, "vertex_index", 1, np.int32).reshape(-1, 3)
        normals = np.zeros((len(mesh.vertices), 3))
        normals[faces.ravel()] = values(mesh.corner_normals, "vector", 3)
        seen = {
            "vertices_m": values(mesh.vertices, "co", 3) @ to_world[:3, :3].T + to_world[:3, 3],
            "normals": normals @ to_world[:3, :3].T,
            "faces": faces,
        }
        if size := mesh.attributes.get("offset_m"):
            seen["offset_m"] = values(size.data, "value", 1).ravel()
        yield seen
        thing.to_mesh_clear()


def values(items: Any, name: str, width: int, dtype: type = np.float32) -> np.ndarray:
    """(N, width) of an attribute of all items."""
    found = np.empty(len(items) * width, dtype)
    items.foreach_get(name, found)
    return found.reshape(-1, width)


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
