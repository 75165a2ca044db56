"""Install the extension, press its button, and save what stands there: runs in Blender's Python.

    python tools/blender_soft_tissue.py JOB

JOB is JSON, written by `tools.try_blender_extension`: the `extension`, a `bvh`, a `glb` without
flesh and one `with_flesh`, some `frames` of these, `later`, by how many frames a second bake begins
later, the folder `scratch` for what Blender keeps, and the `.npz` for what is seen, `out`.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

JOB: dict[str, Any] = json.loads(sys.argv[1])
os.environ["BLENDER_USER_RESOURCES"] = JOB["scratch"]  # before Blender starts
import bpy  # noqa: E402  # pyright: ignore[reportMissingImports]

GAIN, FPS = "soft_tissue_gain", 60


def main() -> None:
    """Do the job, and write its arrays."""
    import addon_utils  # pyright: ignore[reportMissingImports]  # which only `bpy` makes known

    addon_utils.enable("bl_pkg")
    install = bpy.ops.extensions.package_install_files
    install(filepath=JOB["extension"], repo="user_default", enable_on_install=True)
    seen: dict[str, Any] = {"refused": refusals()}
    seen |= pressed("bvh", import_bvh(JOB["bvh"]).name)
    seen |= pressed("glb", import_glb(JOB["glb"]).name)
    np.savez(JOB["out"], **seen)


def pressed(name: str, selected: str) -> dict[str, Any]:
    """What the button makes: at three gains, of a file that is opened again, and baked later."""
    frames = np.array(JOB["frames"]) + bpy.context.scene.frame_start
    before = places(bpy.data.objects[selected], frames) if name == "glb" else np.zeros(0)
    press(selected)
    seen = {f"{name} before": before}
    for gain in (0.0, 2.0, 1.0):
        fleshed()[GAIN] = gain
        fleshed().update_tag()
        seen[f"{name} {gain:g}"] = places(fleshed(), frames)
    blend = str(Path(JOB["scratch"]) / f"{name}.blend")
    bpy.ops.wm.save_as_mainfile(filepath=blend)
    bpy.ops.wm.open_mainfile(filepath=blend)
    seen[f"{name} reopened"] = places(fleshed(), frames)
    count = len(bpy.data.objects)
    bpy.context.scene.frame_start += JOB["later"]
    press(selected)
    seen[f"{name} later"] = places(fleshed(), frames)
    seen[f"{name} more objects"] = np.array(len(bpy.data.objects) - count)
    return seen


def refusals() -> list[str]:
    """What the button says of a scene without anything, and of flesh upon flesh."""
    said = []
    new_scene()
    for begin in (lambda: None, lambda: select(import_glb(JOB["with_flesh"]).name)):
        begin()
        try:
            bpy.ops.object.soft_tissue_bake()
            said.append("nothing")
        except RuntimeError as error:  # as Blender tells what an operator reports
            said.append(str(error).strip())
    return said


def select(name: str) -> None:
    bpy.context.view_layer.objects.active = bpy.data.objects[name]


def press(name: str) -> None:
    """Select it, and bake."""
    select(name)
    bpy.ops.object.soft_tissue_bake()


def fleshed() -> Any:
    """The one object with a gain."""
    [thing] = [thing for thing in bpy.data.objects if GAIN in thing]
    return thing


def new_scene() -> None:
    """An empty scene of sixty frames a second, which keeps what is installed."""
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.context.scene.render.fps = FPS


def import_bvh(path: str) -> Any:
    """The armature of a BVH."""
    new_scene()
    bpy.ops.import_anim.bvh(filepath=path)
    [armature] = [thing for thing in bpy.data.objects if thing.type == "ARMATURE"]
    frame_range(armature)
    return armature


def import_glb(path: str) -> Any:
    """The mesh of a GLB, which its armature moves."""
    new_scene()
    bpy.ops.import_scene.gltf(filepath=path)
    [armature] = [thing for thing in bpy.data.objects if thing.type == "ARMATURE"]
    [mesh] = [thing for thing in bpy.data.objects if thing.find_armature() == armature]
    frame_range(armature)
    return mesh


def frame_range(armature: Any) -> None:
    """The scene plays what the armature's action has."""
    scene, (first, last) = bpy.context.scene, armature.animation_data.action.frame_range
    scene.frame_start, scene.frame_end = round(first), round(last)


def places(thing: Any, frames: Sequence[int]) -> np.ndarray:
    """(N, V, 3) in the world at some frames, all modifiers applied."""
    found = []
    for frame in frames:
        bpy.context.scene.frame_set(int(frame))
        moved = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
        mesh, to_world = moved.to_mesh(), np.array(moved.matrix_world)
        flat = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", flat)
        found.append(flat.reshape(-1, 3) @ to_world[:3, :3].T + to_world[:3, 3])
        moved.to_mesh_clear()
    return np.array(found)


if __name__ == "__main__":
    main()
