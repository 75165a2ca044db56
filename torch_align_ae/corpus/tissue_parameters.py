"""How soft a body is where: from the depth of tissue over its bones."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from bridge.body import BodyModelData
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.posing import shaped_vertices
from torch_align_ae.corpus.soft_tissue import (
    Array,
    TissueParameters,
    cotangent_laplacian,
    vertex_areas_m2,
)

BONY_HZ = 22.0
SOFT_HZ = 3.6
_DAMPING_RATIO = 0.11
# At an offset of 1/sqrt(a) = 2.6 cm the softest springs are twice as stiff as at rest.
_STIFFENING_PER_M2 = 1500.0
_WAVE_SPEED_M_S = 0.7
# Depths at which tissue begins to move and at which it moves freely, metres.
_FIRM_DEPTH_M, _LOOSE_DEPTH_M = 0.05, 0.135
_SMOOTHING_M = 0.03
_BONY_JOINTS = (
    "head", "neck", "left_ankle", "right_ankle", "left_foot", "right_foot",
    "left_wrist", "right_wrist", "left_hand", "right_hand",
)  # fmt: skip


def tissue_parameters(data: BodyModelData, betas: Array) -> TissueParameters:
    """Mechanics of the tissue of the body with shape `betas` (10,)."""
    looseness = tissue_looseness(data, betas)
    # Interpolating periods rather than frequencies keeps half-deep tissue firm.
    frequency_hz = BONY_HZ * (SOFT_HZ / BONY_HZ) ** looseness
    count = len(looseness)
    return TissueParameters(
        frequency_hz=frequency_hz,
        damping_ratio=np.full(count, _DAMPING_RATIO),
        stiffening_per_m2=np.full(count, _STIFFENING_PER_M2),
        wave_speed_m_s=_WAVE_SPEED_M_S,
    )


def tissue_looseness(data: BodyModelData, betas: Array) -> Array:
    """(V,) 0 over bone, 1 where tissue is deep; smooth over the surface."""
    vertices = shaped_vertices(data, betas[None])[0]
    depth_m = bone_distance_m(vertices, data.J_regressor @ vertices, data.parents)
    loose = np.clip((depth_m - _FIRM_DEPTH_M) / (_LOOSE_DEPTH_M - _FIRM_DEPTH_M), 0.0, 1.0)
    bony = [SMPL_JOINT_NAMES.index(name) for name in _BONY_JOINTS]
    loose *= np.clip(1 - 1.5 * data.weights[:, bony].sum(axis=1), 0.0, 1.0)
    return np.clip(smooth_over_surface(loose, vertices, data.faces, _SMOOTHING_M), 0.0, 1.0)


def bone_distance_m(vertices: Array, joints: Array, parents: np.ndarray) -> Array:
    """(V,) distance from each vertex to the nearest bone, metres."""
    nearest = np.full(len(vertices), np.inf)
    for joint, parent in enumerate(parents):
        if parent < 0:
            continue
        bone = joints[joint] - joints[parent]
        share = np.clip((vertices - joints[parent]) @ bone / (bone @ bone), 0.0, 1.0)
        foot = joints[parent] + share[:, None] * bone
        nearest = np.minimum(nearest, np.linalg.norm(vertices - foot, axis=1))
    return nearest


def smooth_over_surface(
    values: Array, vertices: Array, faces: np.ndarray, length_m: float
) -> Array:
    """Diffuse `values` (V,) along the surface over about `length_m`."""
    mass = sp.diags(vertex_areas_m2(vertices, faces))
    system = mass + length_m**2 * cotangent_laplacian(vertices, faces)
    return spsolve(system.tocsc(), mass @ values)
