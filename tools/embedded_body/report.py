"""Print what was measured on the bodies that are written; NOTICE.md quotes these lines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import trimesh

from bridge.body.model_data import SMPL_JOINT_NAMES, BodyModelData
from bridge.body.posing import pose_vertices, shaped_joints, shaped_vertices
from tools.embedded_body.correctives import CorrectiveFit
from tools.embedded_body.shape_space import ShapeSpace

_BENDS = (
    ("left_knee", (2.0, 0.0, 0.0)),
    ("left_elbow", (0.0, -2.0, 0.0)),
    ("left_hip", (-1.8, 0.0, 0.0)),
    ("left_shoulder", (0.0, 0.0, 1.2)),
)
_TISSUE_KG_PER_M3 = 985.0


def mesh(vertices: np.ndarray, faces: np.ndarray) -> None:
    """Closedness, Euler characteristic and edge lengths."""
    surface = trimesh.Trimesh(vertices, faces, process=False)
    edges_mm = np.percentile(surface.edges_unique_length, [5, 50, 95, 100]) * 1e3
    print(f"{len(vertices)} vertices, {len(faces)} faces, closed {surface.is_watertight}")
    print(f"Euler characteristic {surface.euler_number}")
    print(f"edges 5/50/95/100 %: {edges_mm.round(1)} mm")


def population(gender: str, bodies: np.ndarray, faces: np.ndarray) -> None:
    """Range of the sampled statures and body mass indices."""
    stature_m = np.ptp(bodies[..., 1], axis=1)
    mass_kg = _TISSUE_KG_PER_M3 * np.array([_volume_m3(body, faces) for body in bodies])
    bmi = np.percentile(mass_kg / stature_m**2, [0, 5, 50, 95, 100])
    print(f"{gender}: {len(bodies)} bodies")
    print(f"  stature 0/50/100 %: {np.percentile(stature_m, [0, 50, 100]).round(3)} m")
    print(f"  body mass index 0/5/50/95/100 %: {bmi.round(1)} kg/m^2")


def shapes(body: BodyModelData, space: ShapeSpace) -> None:
    """What the betas explain and what the first ones do."""
    residual_mm = space.residual_m * 1e3
    print(f"  10 components: {space.explained:.4%} of the variance")
    print(f"  residual: mean {residual_mm.mean():.2f} mm, max {residual_mm.max():.2f} mm")
    for component in range(4):
        betas = np.zeros((2, 10))
        betas[:, component] = -2.0, 2.0
        ends = shaped_vertices(body, betas)
        low_m, high_m = np.ptp(ends[..., 1], axis=1)
        low_l, high_l = (_volume_m3(end, body.faces) * 1e3 for end in ends)
        print(
            f"  beta[{component}] from -2 to +2: stature {low_m:.3f} to {high_m:.3f} m, "
            f"volume {low_l:.1f} to {high_l:.1f} l"
        )


def unseen(body: BodyModelData, vertices: np.ndarray, joints: np.ndarray) -> None:
    """Error of 10 betas and of the joint regressor on bodies that no fit has seen."""
    directions = body.shapedirs.reshape(-1, body.shapedirs.shape[-1])
    deviations = (vertices - body.v_template).reshape(len(vertices), -1)
    betas = np.linalg.lstsq(directions, deviations.T, rcond=None)[0].T
    vertex_mm = np.linalg.norm(shaped_vertices(body, betas) - vertices, axis=-1) * 1e3
    joint_mm = np.linalg.norm(shaped_joints(body, betas) - joints, axis=-1) * 1e3
    worst = int(joint_mm.mean(axis=0).argmax())
    print(f"  {len(vertices)} unseen bodies:")
    print(f"    vertices: mean {vertex_mm.mean():.2f} mm, max {vertex_mm.max():.2f} mm")
    print(
        f"    joints: mean {joint_mm.mean():.2f} mm, max {joint_mm.max():.2f} mm, "
        f"worst joint's mean {joint_mm[:, worst].mean():.2f} mm ({SMPL_JOINT_NAMES[worst]})"
    )
    regressor = body.J_regressor.data
    print(f"    regressor's weights: {regressor.min():.2f} to {regressor.max():.2f}")


def pose_blend_shapes(body: BodyModelData, fit: CorrectiveFit) -> None:
    """Quality of the fit, and the volume of bends without and with the blend shapes."""
    print(f"  pose blend shapes: R2 {fit.r2_fit:.3f}, {fit.r2_unseen:.3f} on unseen poses")
    print(f"    linear blending is {fit.lbs_error_m * 1e3:.2f} mm (rms) off the better skinning")
    print(f"    largest displacement in the rest frame: {fit.largest_m * 1e3:.1f} mm")
    linear = replace(body, posedirs=np.zeros_like(body.posedirs))
    for joint, axis_angle in _BENDS:
        pose = np.zeros((1, 24, 3))
        pose[0, SMPL_JOINT_NAMES.index(joint)] = axis_angle
        without_ml, with_ml = (_volume_change_ml(model, pose) for model in (linear, body))
        degrees = np.rad2deg(np.abs(pose).max())
        print(
            f"    {joint} turned by {degrees:.0f} degrees: volume {without_ml:+.0f} ml without, "
            f"{with_ml:+.0f} ml with them"
        )


def _volume_change_ml(body: BodyModelData, pose: np.ndarray) -> float:
    betas, trans = np.zeros((1, 10)), np.zeros((1, 3))
    posed = pose_vertices(body, betas, pose, trans)[0]
    return (_volume_m3(posed, body.faces) - _volume_m3(body.v_template, body.faces)) * 1e6


def _volume_m3(vertices: np.ndarray, faces: np.ndarray) -> float:
    return float(trimesh.Trimesh(vertices, faces, process=False).volume)
