"""The button, its panel in the sidebar of the 3D view, and what they do."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path
from typing import Any

import bpy  # pyright: ignore[reportMissingImports]
import numpy as np

from bridge.errors import DsnetError
from bridge.motion.skeletons import read_joint_map
from dsnet.blender.flesh import SceneFlesh, flesh_beside, flesh_of_mesh
from dsnet.blender.read_scene import (
    armature_at_rest,
    chosen,
    frames_of,
    mesh_at_rest,
    rate_of,
)
from dsnet.blender.rest_mesh import mesh_body
from dsnet.blender.scene_motion import SceneArmature
from dsnet.blender.write_scene import GAIN, body_of, write_body, write_keys

_TICK_S = 0.01
_FRAMES_A_TICK = 16
_READING = 0.2
"""Share of the time in which the scene is read."""


class BakeSettings(bpy.types.PropertyGroup):
    gender: bpy.props.EnumProperty(  # pyright: ignore[reportInvalidTypeForm]
        name="Gender",
        items=[("female", "Female", "A woman's flesh"), ("male", "Male", "A man's flesh")],
    )
    shape: bpy.props.StringProperty(  # pyright: ignore[reportInvalidTypeForm]
        name="Shape",
        description="Of a body beside an armature: heavy,tall or height=182 weight=80",
    )
    joint_map: bpy.props.StringProperty(  # pyright: ignore[reportInvalidTypeForm]
        name="Joint map",
        description="Text file, a joint a line: left_hip = Bip01 L Thigh",
        subtype="FILE_PATH",
    )


class SOFT_TISSUE_OT_bake(bpy.types.Operator):
    """Predict the soft tissue of the selected mesh or armature in the scene's frame range"""

    bl_idname = "object.soft_tissue_bake"
    bl_label = "Bake soft tissue"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    def execute(self, context: Any) -> set[str]:
        """All at once, as scripts call it."""
        self._begin(context)
        while not (ended := self._go_on(context)):
            pass
        return ended

    def invoke(self, context: Any, event: Any) -> set[str]:
        """Piece by piece, while the window stays alive; Esc ends it with nothing changed."""
        self._begin(context)
        self._timer = context.window_manager.event_timer_add(_TICK_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: Any, event: Any) -> set[str]:
        """The next piece."""
        if event.type == "ESC":
            ended = self._end(context, {"CANCELLED"})
        elif event.type != "TIMER":
            return {"RUNNING_MODAL"}
        else:
            ended = self._go_on(context)
        if not ended:
            return {"RUNNING_MODAL"}
        context.window_manager.event_timer_remove(self._timer)
        return ended

    def _begin(self, context: Any) -> None:
        self._work: Generator[float, None, None] = self._bake(context)
        context.window_manager.progress_begin(0, 1)

    def _go_on(self, context: Any) -> set[str]:
        """The next piece, and how it has ended, if it has."""
        try:
            context.window_manager.progress_update(next(self._work))
        except StopIteration:
            return self._end(context, {"FINISHED"})
        except DsnetError as error:
            self.report({"ERROR"}, str(error))
            return self._end(context, {"CANCELLED"})
        except OSError as error:
            self.report({"ERROR"}, f"the point cache cannot be written: {error.strerror or error}")
            return self._end(context, {"CANCELLED"})
        return set()

    def _end(self, context: Any, how: set[str]) -> set[str]:
        self._work.close()
        context.window_manager.progress_end()
        return how

    def _bake(self, context: Any) -> Generator[float, None, None]:
        """The work in pieces: the share that is done after each."""
        scene, settings = context.scene, context.scene.soft_tissue
        armature, mesh = chosen(context.active_object)
        joints = settings.joint_map and read_joint_map(Path(bpy.path.abspath(settings.joint_map)))
        at_rest, worlds = armature_at_rest(armature, rate_of(scene)), list[np.ndarray]()
        # First, as a body that lacks joints is refused before anything is read.
        made = mesh and mesh_body(mesh_at_rest(mesh, at_rest.bones), at_rest, joints or {})
        count = max(1, scene.frame_end + 1 - scene.frame_start)
        for world in frames_of(scene, armature, at_rest.bones):
            worlds.append(world)
            if not len(worlds) % _FRAMES_A_TICK:
                yield _READING * len(worlds) / count
        moving = SceneArmature(
            at_rest.name, at_rest.bones, at_rest.parents, at_rest.rest, np.array(worlds),
            at_rest.fps,
        )  # fmt: skip
        motion = moving.motion(joints or {})
        if made:
            flesh = flesh_of_mesh(made, motion, settings.gender)
        else:
            flesh = flesh_beside(motion, settings.gender, settings.shape.split())
        self._warn(flesh)
        first = scene.frame_start + flesh.first
        if made:
            steps = write_keys(mesh, flesh, made.to_world, first)
        else:
            steps = write_body(armature, flesh, first, scene)
        for done in steps:
            yield _READING + (1 - _READING) * done / len(flesh)
        scene.frame_set(scene.frame_current)

    def _warn(self, flesh: SceneFlesh) -> None:
        for line in flesh.warnings():
            self.report({"WARNING"}, line)


class SOFT_TISSUE_PT_panel(bpy.types.Panel):
    bl_label = "Soft tissue"
    bl_space_type, bl_region_type, bl_category = "VIEW_3D", "UI", "Soft tissue"

    def draw(self, context: Any) -> None:
        """The options, the button, and the gain of what has its flesh."""
        settings, selected = context.scene.soft_tissue, context.active_object
        for name in ("gender", "shape", "joint_map"):
            self.layout.prop(settings, name)
        self.layout.operator(SOFT_TISSUE_OT_bake.bl_idname)
        if selected is not None and selected.type == "ARMATURE":
            selected = body_of(selected)
        if selected is not None and GAIN in selected:
            self.layout.prop(selected, f'["{GAIN}"]', text="Gain")


_CLASSES = (BakeSettings, SOFT_TISSUE_OT_bake, SOFT_TISSUE_PT_panel)


def register() -> None:
    for one in _CLASSES:
        bpy.utils.register_class(one)
    bpy.types.Scene.soft_tissue = bpy.props.PointerProperty(type=BakeSettings)


def unregister() -> None:
    del bpy.types.Scene.soft_tissue
    for one in reversed(_CLASSES):
        bpy.utils.unregister_class(one)
