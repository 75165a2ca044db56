"""How soft a body is where: from the depth of tissue over its bones."""

from __future__ import annotations

import numpy as np

from bridge.body import BodyModelData
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.posing import shaped_vertices
from torch_align_ae.corpus.soft_tissue import Array, TissueParameters
from torch_align_ae.corpus.surface import smooth_over_surface

BONY_HZ = 22.0
SOFT_HZ = 3.6
_DAMPING_RATIO = 0.11
# At an offset of 1/sqrt(a) = 2.6 cm the springs are twice as stiff as at rest.
_STIFFENING_PER_M2 = 1500.0
_WAVE_SPEED_M_S = 1.3
# Tissue moves freely from this depth on, metres.
_LOOSE_DEPTH_M = 0.075
_SMOOTHING_M = 0.03
# Below this looseness skin lies on bone and does not move at all.
_HELD_BELOW = 0.02
_BONY_JOINTS = (
    "head", "neck", "left_ankle", "right_ankle", "left_foot", "right_foot",
    "left_wrist", "right_wrist", "left_hand", "right_hand",
)  # fmt: skip
# Radius of bone and firm muscle about the line from a joint's parent to the joint; the trunk's
# is that of ribs and pelvis.
_FIRM_RADIUS_M = {
    "hip": 0.065, "knee": 0.048, "ankle": 0.042, "foot": 0.05, "spine1": 0.07, "spine2": 0.072,
    "spine3": 0.078, "neck": 0.07, "head": 0.07, "collar": 0.06, "shoulder": 0.055,
    "elbow": 0.032, "wrist": 0.032, "hand": 0.04,
}  # fmt: skip


def tissue_parameters(data: BodyModelData, betas: Array) -> TissueParameters:
    """Mechanics of the tissue of the body with shape `betas` (10,)."""
    looseness = tissue_looseness(data, betas)
    count = len(looseness)
    return TissueParameters(
        # The geometric mean keeps half-deep tissue firmer than the arithmetic one would.
        frequency_hz=BONY_HZ * (SOFT_HZ / BONY_HZ) ** looseness,
        damping_ratio=np.full(count, _DAMPING_RATIO),
        stiffening_per_m2=np.full(count, _STIFFENING_PER_M2),
        wave_speed_m_s=_WAVE_SPEED_M_S,
        free=looseness >= _HELD_BELOW,
    )


def tissue_looseness(data: BodyModelData, betas: Array) -> Array:
    """(V,) 0 over bone, 1 where tissue is deep; smooth over the surface."""
    vertices = shaped_vertices(data, betas[None])[0]
    depth_m = tissue_depth_m(vertices, data.J_regressor @ vertices, data.parents)
    loose = np.clip(depth_m / _LOOSE_DEPTH_M, 0.0, 1.0)
    bony = [SMPL_JOINT_NAMES.index(name) for name in _BONY_JOINTS]
    loose *= np.clip(1 - 1.5 * data.weights[:, bony].sum(axis=1), 0.0, 1.0)
    return np.clip(smooth_over_surface(loose, vertices, data.faces, _SMOOTHING_M), 0.0, 1.0)


def tissue_depth_m(vertices: Array, joints: Array, parents: np.ndarray) -> Array:
    """(V,) distance from each vertex to the surface of the nearest bone, metres."""
    depth_m = np.full(len(vertices), np.inf)
    for joint, parent in enumerate(parents):
        if parent < 0:
            continue
        bone = joints[joint] - joints[parent]
        share = np.clip((vertices - joints[parent]) @ bone / (bone @ bone), 0.0, 1.0)
        nearest = joints[parent] + share[:, None] * bone
        radius_m = _FIRM_RADIUS_M[SMPL_JOINT_NAMES[joint].split("_")[-1]]
        depth_m = np.minimum(depth_m, np.linalg.norm(vertices - nearest, axis=1) - radius_m)
    return depth_m
