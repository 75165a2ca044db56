"""A person as Blender's scenes hold one: an armature and its mesh, z up."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.body import BodyModelData, load_body_model
from bridge.body.posing import posed_joints, shaped_joints, shaped_vertices
from bridge.motion import Motion
from dsnet.blender.rest_mesh import SceneMesh
from dsnet.blender.scene_motion import SceneArmature

UP = Rotation.from_euler("x", 90, degrees=True).as_matrix()


def scene_armature(
    motion: Motion, body: BodyModelData | None = None, unit: float = 1.0
) -> SceneArmature:
    """With bones whose frames lie anyhow; `unit` is how many units of the scene a metre has."""
    body = body or load_body_model("embedded:female")
    moved, _ = posed_joints(body, motion.betas, motion.pose, motion.trans_m)
    rest = np.tile(np.eye(4), (len(body.parents), 1, 1))
    rest[:, :3, :3] = Rotation.random(len(rest), random_state=3).as_matrix()
    rest[:, :3, 3] = shaped_joints(body, motion.betas[None])[0]
    return SceneArmature(
        name="Armature",
        bones=body.joint_names,
        parents=tuple(body.parents.tolist()),
        rest=_in_scene(rest, unit),
        world=_in_scene(moved @ rest, unit),
        fps=motion.fps,
    )


def scene_mesh(
    body: BodyModelData, betas: NDArray, order: NDArray[np.intp] | None = None, unit: float = 1.0
) -> SceneMesh:
    """The body at rest, its vertices in another order."""
    order = np.arange(body.vertex_count) if order is None else order
    number = np.argsort(order)
    vertices = shaped_vertices(body, betas[None])[0][order]
    return SceneMesh("Body", unit * vertices @ UP.T, number[body.faces], body.weights[order])


def _in_scene(matrices: NDArray[np.float64], unit: float) -> NDArray[np.float64]:
    to_scene = np.eye(4)
    to_scene[:3, :3] = UP * unit
    return to_scene @ matrices
