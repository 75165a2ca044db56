"""Softness of each vertex, by the part of the body and the depth of soft tissue over its bones.

In one part tissue sags by the same share of its depth everywhere, so its frequency is in proportion
to one over the square root of the depth: thicker tissue is softer. Skin on bone does not move.

`SOFT_TISSUE` and the constants after it have their sources beside them; docs/data.md shows the
same table, and a test compares the two.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from bridge.body import BodyModelData
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.parts import PARTS, part_weights
from bridge.body.posing import shaped_vertices
from bridge.body.surface_operators import cotangent_laplacian, vertex_areas_m2
from dsnet.synthetic.soft_tissue import Array, TissueParameters


class PartTissue(NamedTuple):
    """Soft tissue of one part of the body."""

    frequency_hz: float  # of a small vertical vibration, standing, without neighbours
    depth_m: float  # of tissue over the bone with that frequency
    damping_ratio: float  # of that vibration
    source: str


_NOT_MEASURED = "not measured; damping as elsewhere"
SOFT_TISSUE = {
    "chest": PartTissue(
        3.3, 0.050, 0.215, "breast: damping 0.215, most at 4 Hz (Chen, Ng, Yu 2013)"
    ),
    "belly": PartTissue(
        5.5, 0.060, 0.22, "unknown; viscera 50 to 80 mm in hops (Minetti, Belli 1994)"
    ),
    "back": PartTissue(6.0, 0.040, 0.22, _NOT_MEASURED),
    "buttocks": PartTissue(5.5, 0.050, 0.22, _NOT_MEASURED),
    "upper_arms": PartTissue(7.0, 0.025, 0.22, _NOT_MEASURED),
    "forearms": PartTissue(10.0, 0.015, 0.22, _NOT_MEASURED),
    "thighs": PartTissue(
        8.0, 0.070, 0.30, "rings at 10 to 11 Hz after a hop (Cereatti's bone pins)"
    ),
    "calves": PartTissue(10.0, 0.045, 0.30, "10 to 65 Hz (Wakeling 2001)"),
}
"""By part of the body (`bridge.body.parts`); on other parts the skin lies on bone."""
MENS_SOFT_TISSUE = {
    "chest": PartTissue(
        4.0, 0.050, 0.22, "muscle: half as far as before, by markers on a man's kick"
    ),
}
"""Parts in which men's differs."""
PRELOAD = 2.0
"""Sag in standing relative to linear springs; 2: without weight the frequency is half. From markers
on a jumping woman, with whom stiffening about the standing shape would have the wrong sign."""
WAVE_SPEED_M_S = 0.4
"""Couples skin with its neighbours; markers give 0.3 to 0.6, correlated with the frequency."""
FIRMEST_HZ = 20.0
"""Highest frequency, of thin tissue beside bone."""

# Radius of bone about the line from a joint's parent to the joint; in the trunk that of spine and
# pelvis with the firm tissue around them.
_BONE_RADIUS_M = {
    "hip": 0.065, "knee": 0.030, "ankle": 0.022, "foot": 0.05, "spine1": 0.07, "spine2": 0.072,
    "spine3": 0.078, "neck": 0.07, "head": 0.07, "collar": 0.06, "shoulder": 0.055,
    "elbow": 0.022, "wrist": 0.016, "hand": 0.04,
}  # fmt: skip
# Radius of a bone's thick end.
_JOINT_RADIUS_M = {"knee": 0.05, "ankle": 0.04, "elbow": 0.036, "wrist": 0.03}
# The ribs' width over their depth; half the width of the breastbone, and of its border.
_RIBS_WIDTH = 1.6
_BREASTBONE_M = (0.024, 0.010)
# Standard deviations, lateral and vertical, of the weights of skin on breastbone and spine.
_MIDDLE_M = np.array([0.015, 0.020])
# The shin lies in front of the line from knee to ankle: cosine of the angle at its border.
_SHIN_COSINE = (0.85, 0.15)
_DEPTH_SMOOTHING_M, _BONE_SMOOTHING_M = 0.03, 0.01


def tissue_parameters(data: BodyModelData, betas: Array) -> TissueParameters:
    """Mechanics of the tissue of the body with shape `betas` (10,)."""
    vertices = shaped_vertices(data, betas[None])[0]
    bone = on_bone(data, vertices)
    parts = part_weights(data)[:, [PARTS.index(name) for name in SOFT_TISSUE]]
    parts = parts / np.maximum(parts.sum(axis=1, keepdims=True), 1e-3)
    tissue = SOFT_TISSUE | (MENS_SOFT_TISSUE if data.gender == "male" else {})
    frequency_hz, depth_m, damping_ratio = np.array([row[:3] for row in tissue.values()]).T
    softness = np.exp(parts @ np.log(frequency_hz**2 * depth_m))
    local_depth_m = tissue_depth_m(data, vertices) * np.clip(1 - 2 * bone, 0.0, 1.0)
    return TissueParameters(
        frequency_hz=np.sqrt(softness / np.maximum(local_depth_m, softness / FIRMEST_HZ**2)),
        damping_ratio=parts @ damping_ratio,
        preload=PRELOAD,
        wave_speed_m_s=WAVE_SPEED_M_S,
        free=bone < 0.5,
    )


def on_bone(data: BodyModelData, vertices: Array) -> Array:
    """(V,) 1 where skin lies on bone, 0 on soft tissue, smooth between, of a shaped body (V, 3).

    Bone is at skull and neck, hands, feet, shins and breastbone.
    """
    parts = dict(zip(PARTS, part_weights(data).T, strict=True))
    bone = parts["head"] + parts["hands"] + parts["feet"]
    half, border = _BREASTBONE_M
    stature = np.ptp(vertices[:, 1]) / 1.7
    aside = np.abs(vertices[:, 0]) / stature
    # Down to the tip of the breastbone, where the chest fades into the belly.
    bone = bone + np.minimum(4 * parts["chest"], 1) * _fall((aside - half) / border)
    joints = data.J_regressor @ vertices
    for side in ("left", "right"):
        knee, ankle = (SMPL_JOINT_NAMES.index(f"{side}_{name}") for name in ("knee", "ankle"))
        away = _from_line(vertices, joints[knee], joints[ankle])
        cosine = away[:, 2] / np.maximum(np.linalg.norm(away, axis=1), 1e-9)
        bone = bone + data.weights[:, knee] * _fall((_SHIN_COSINE[0] - cosine) / _SHIN_COSINE[1])
    bone = smooth_over_surface(np.clip(bone, 0.0, 1.0), vertices, data.faces, _BONE_SMOOTHING_M)
    return np.clip(bone, 0.0, 1.0)


def tissue_depth_m(data: BodyModelData, vertices: Array) -> Array:
    """(V,) depth of soft tissue under the skin of a shaped body (V, 3), metres, smoothed."""
    joints = data.J_regressor @ vertices
    depth_m = np.full(len(vertices), np.inf)
    for joint, parent in enumerate(data.parents):
        if parent < 0:
            continue
        name = SMPL_JOINT_NAMES[joint].split("_")[-1]
        away = _from_line(vertices, joints[parent], joints[joint])
        depth_m = np.minimum(depth_m, np.linalg.norm(away, axis=1) - _BONE_RADIUS_M[name])
        if name in _JOINT_RADIUS_M:
            apart = np.linalg.norm(vertices - joints[joint], axis=1)
            depth_m = np.minimum(depth_m, apart - _JOINT_RADIUS_M[name])
    chest = part_weights(data)[:, PARTS.index("chest")]
    depth_m = (1 - chest) * depth_m + chest * _over_ribs_m(data, vertices)
    depth_m = smooth_over_surface(
        np.maximum(depth_m, 0.0), vertices, data.faces, _DEPTH_SMOOTHING_M
    )
    return np.maximum(depth_m, 0.0)


def _over_ribs_m(data: BodyModelData, vertices: Array) -> Array:
    """(V,) distance of skin from an ellipse, at each height, through breastbone and spine.

    At these two skin lies on bone; between them the distance is the depth of breast or muscle.
    """
    parts = dict(zip(PARTS, part_weights(data).T, strict=True))
    front = _middle_z_m(vertices, parts["chest"] + parts["belly"])
    back = _middle_z_m(vertices, parts["back"] + parts["buttocks"])
    thick = np.maximum((front - back) / 2, 0.01)
    x, z = vertices[:, 0], vertices[:, 2] - (front + back) / 2
    out = np.sqrt((x / (_RIBS_WIDTH * thick)) ** 2 + (z / thick) ** 2)
    return np.hypot(x, z) * (1 - 1 / np.maximum(out, 1.0))


def _middle_z_m(vertices: Array, weights: Array) -> Array:
    """(V,) z of the skin in the sagittal plane at each vertex's height, by weights (V,)."""
    chosen = np.flatnonzero((weights > 0.5) & (np.abs(vertices[:, 0]) < 3 * _MIDDLE_M[0]))
    x, y, z = vertices[chosen].T
    heights = (vertices[:, 1, None] - y) / _MIDDLE_M[1]
    near = np.exp(-((x / _MIDDLE_M[0]) ** 2 + np.minimum(heights**2, 600.0)) / 2)
    return near @ z / near.sum(axis=1)


def _from_line(points: Array, start: Array, stop: Array) -> Array:
    """Vectors (N, 3) to points (N, 3) from the nearest point between start and stop."""
    line = stop - start
    fraction = np.clip((points - start) @ line / (line @ line), 0.0, 1.0)
    return points - start - fraction[:, None] * line


def _fall(x: Array) -> Array:
    """From 1 at -1 to 0 at 1."""
    return np.clip((1 - x) / 2, 0.0, 1.0)


def smooth_over_surface(
    values: Array, vertices: Array, faces: NDArray[np.integer], length_m: float
) -> Array:
    """Diffuse `values` (V,) or (V, n) along the surface over about `length_m`."""
    mass = sp.diags(vertex_areas_m2(vertices, faces))
    system = mass + length_m**2 * cotangent_laplacian(vertices, faces)
    return splu(system.tocsc()).solve(mass @ values)
