"""Soft tissue in a scene of Blender: shape keys of a mesh, or point caches of a body.

The gain is a property of the object that drivers read, so a file shows its flesh without this
extension too.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import bpy  # pyright: ignore[reportMissingImports]
import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from dsnet.blender.flesh import LARGEST_GAIN, KeyFit, SceneFlesh
from dsnet.blender.read_scene import OF, body_vertices
from dsnet.exporters.mesh_files import pc2_header
from dsnet.prediction.transfer_cache import cache_folder

GAIN, VALUES = "soft_tissue_gain", "soft_tissue"
"""Properties: of the object, and of the mesh the values of its shape keys at gain 1."""
_KEY = "Soft tissue "
_ALONE, _FLESH = "SMPL alone", "Soft tissue"
"""Modifiers of a body: the second goes from the first to the flesh at the largest gain."""


def with_gain(thing: Any) -> None:
    """Give an object the property, at 1 where it has none."""
    if GAIN not in thing:
        thing[GAIN] = 1.0
        about = "Multiplies the soft tissue: 0 is SMPL alone"
        thing.id_properties_ui(GAIN).update(
            min=0.0, max=LARGEST_GAIN, soft_max=3.0, default=1.0, description=about
        )


def write_keys(
    thing: Any, flesh: SceneFlesh, to_world: NDArray[np.float64], first: int
) -> Iterator[int]:
    """Shape keys on a mesh, in place of those of an earlier bake; yields how many frames are done.

    Parameters
    ----------
    to_world : (3, 3) from directions of the body model to the world's.
    first : the frame of the scene in which the motion begins.
    """
    fit, done = KeyFit(), 0
    for offsets_m in flesh.offsets():
        fit.add(offsets_m)
        yield (done := done + len(offsets_m))
    found = fit.shapes()
    remove_keys(thing)
    with_gain(thing)
    mesh = thing.data
    if mesh.shape_keys is None:
        thing.shape_key_add(name="Basis", from_mix=False)
    to_local = np.linalg.inv(np.array(thing.matrix_world)[:3, :3]) @ to_world
    basis = np.empty(3 * len(mesh.vertices), np.float32)
    thing.data.shape_keys.key_blocks[0].data.foreach_get("co", basis)
    mesh[VALUES] = [0.0] * len(found.shapes_m)
    vertex = body_vertices(mesh)
    for number, shape_m in enumerate(found.shapes_m):
        key = thing.shape_key_add(name=f"{_KEY}{number:03d}", from_mix=False)
        key.slider_min, key.slider_max = -10.0, 10.0
        moved = (shape_m[vertex] @ to_local.T).astype(np.float32).ravel()
        key.data.foreach_set("co", basis + moved)
        _drive(
            key, "value", "gain * share",
            gain=(thing, f'["{GAIN}"]'), share=(mesh, f'["{VALUES}"][{number}]'),
        )  # fmt: skip
    _animate(mesh, found.values, first)


def remove_keys(thing: Any) -> None:
    """Take those of an earlier bake away."""
    mesh = thing.data
    if mesh.shape_keys is not None:
        for key in [key for key in mesh.shape_keys.key_blocks if key.name.startswith(_KEY)]:
            key.driver_remove("value")
            thing.shape_key_remove(key)
    if VALUES in mesh:
        del mesh[VALUES]
    action = mesh.animation_data and mesh.animation_data.action
    if action and action.name.startswith(_KEY):
        bpy.data.actions.remove(action)


def write_body(armature: Any, flesh: SceneFlesh, first: int, scene: Any) -> Iterator[int]:
    """A body beside an armature, or new caches for the one that is there; yields how many frames
    are done. The two caches appear when they are complete."""
    folder = _cache_folder()
    stem = re.sub(r"\W", "_", armature.name)
    paths = [folder / f"{stem}_{name}.pc2" for name in ("alone", "flesh")]
    base_m, done = np.zeros((0, 3)), 0
    with _written(paths[0]) as alone, _written(paths[1]) as most:
        for file in (alone, most):
            file.write(pc2_header(flesh.moving.body.vertex_count, len(flesh)))
        for alone_m, most_m in flesh.surfaces():
            base_m = base_m if done else alone_m[0]
            alone.write(np.ascontiguousarray(alone_m, "<f4").tobytes())
            most.write(np.ascontiguousarray(most_m, "<f4").tobytes())
            yield (done := done + len(alone_m))
    body = _body_beside(armature, flesh.moving.body, base_m, scene)
    for name, path in zip((_ALONE, _FLESH), paths, strict=True):
        modifier = body.modifiers.get(name) or body.modifiers.new(name, "MESH_CACHE")
        modifier.cache_format, modifier.time_mode = "PC2", "FRAME"
        modifier.frame_start, modifier.play_mode = first, "SCENE"
        modifier.filepath = ""  # else the file that was read stays
        modifier.filepath = bpy.path.relpath(str(path)) if bpy.data.filepath else str(path)
    _drive(body.modifiers[_FLESH], "factor", f"gain / {LARGEST_GAIN:g}", gain=(body, f'["{GAIN}"]'))


@contextmanager
def _written(path: Path) -> Iterator[IO[bytes]]:
    """A file that takes its place when it is complete; nothing is left of half a one."""
    partial = path.with_suffix(".partial")
    try:
        with partial.open("wb") as file:
            yield file
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def _cache_folder() -> Path:
    """Beside the .blend, or the user's own where it has not been saved."""
    beside = Path(bpy.data.filepath).parent / "soft_tissue" if bpy.data.filepath else None
    folder = beside or cache_folder() / "blender"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def body_of(armature: Any) -> Any:
    """The body that was put beside an armature; None where there is none."""
    return next((one for one in bpy.data.objects if one.get(OF) == armature), None)


def _body_beside(armature: Any, model: BodyModelData, base_m: NDArray, scene: Any) -> Any:
    """The body with the mesh of this model, in the scene."""
    mesh = bpy.data.meshes.new(f"{armature.name} body")
    mesh.from_pydata(base_m.tolist(), [], model.faces.tolist())
    if model.texture is not None:
        places = model.texture.places[model.texture.corners.ravel()]
        mesh.uv_layers.new(name="MakeHuman").data.foreach_set(
            "uv", places.astype(np.float32).ravel()
        )
    mesh.polygons.foreach_set("use_smooth", np.ones(len(mesh.polygons), bool))
    mesh.update()
    body = body_of(armature)
    if body is None:
        body = bpy.data.objects.new(f"{armature.name} body", mesh)
        scene.collection.objects.link(body)
        body[OF] = armature
    else:
        before, body.data = body.data, mesh
        bpy.data.meshes.remove(before)
    with_gain(body)
    return body


def _drive(owner: Any, name: str, expression: str, **variables: tuple[Any, str]) -> None:
    """Let a property follow properties of objects and meshes: an expression that Blender computes
    without Python, so that files need not be trusted."""
    owner.driver_remove(name)
    driver = owner.driver_add(name).driver
    driver.type = "SCRIPTED"
    for variable, (source, path) in variables.items():
        made = driver.variables.new()
        made.name, made.type = variable, "SINGLE_PROP"
        target = made.targets[0]
        target.id_type = source.id_type
        target.id, target.data_path = source, path
    driver.expression = expression


def _animate(mesh: Any, values: NDArray[np.float32], first: int) -> None:
    """Keys of the mesh's property, one a frame, with straight lines between them."""
    action = bpy.data.actions.new(f"{_KEY}{mesh.name}")
    mesh.animation_data_create().action = action
    frames = first + np.arange(len(values))
    for number, column in enumerate(values.T):
        curve = _curve(action, mesh, f'["{VALUES}"]', number)
        curve.keyframe_points.add(len(frames))
        keys = np.stack([frames, column], axis=1).astype(np.float32)
        curve.keyframe_points.foreach_set("co", keys.ravel())
        linear = np.ones(len(frames), np.int32)  # as Blender numbers them
        curve.keyframe_points.foreach_set("interpolation", linear)
        curve.update()


def _curve(action: Any, owner: Any, path: str, index: int) -> Any:
    """A new curve of an action: Blender 5 has them by what they move."""
    if hasattr(action, "fcurve_ensure_for_datablock"):
        return action.fcurve_ensure_for_datablock(owner, path, index=index)
    return action.fcurves.new(path, index=index)
