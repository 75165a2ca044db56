"""How thick the second law's layer is where: from girth, corpulence and prominence.

A layer of thickness h on firm ground swings along itself in its first mode at c / 4h, c the speed
of shear waves: what is thick is soft. Thickness is a share of the limb's radius, which its girth
gives, times the body's corpulence, its mass over squared height; what stands out has more of it.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from benchmarks.laws.second_tissue import Array, LayerParameters
from bridge.body import BodyModelData
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.posing import shaped_vertices
from bridge.body.surface_operators import (
    cotangent_laplacian,
    vertex_areas_m2,
    vertex_normals,
)

_SHEAR_SPEED_M_S = 1.0
_DENSITY_KG_M3 = 985.0
# Mass over squared height at which flesh is what the shares below say.
_USUAL_CORPULENCE_KG_M2 = 22.0
_HELD_BELOW_M = 0.011
_THICKEST_M = 0.072
# Lengths over which a body is rounded to tell what stands out, and thickness is spread.
_ROUNDING_M, _SPREADING_M = 0.06, 0.025
# What stands out by this has twice the flesh, within the limits.
_PROMINENT_M = 0.035
_PROMINENCE = (0.6, 1.4)
# The Maxwell elements of thick flesh give way later than those of thin flesh.
_RELAXATION_S = (0.02, 0.05)
# Share of flesh in a segment's radius, and of that the share that is muscle; a segment goes from
# the joint to the next.
_FLESH_AND_MUSCLE = {
    "pelvis": (0.5, 0.5), "hip": (0.62, 0.8), "knee": (0.55, 0.9), "spine1": (0.62, 0.3),
    "spine2": (0.6, 0.3), "spine3": (0.42, 0.5), "neck": (0.35, 0.4), "collar": (0.6, 0.7),
    "shoulder": (0.68, 0.9), "elbow": (0.5, 0.9), "ankle": (0.1, 0.0),
}  # fmt: skip


def layer_parameters(data: BodyModelData, betas: Array) -> LayerParameters:
    """Mechanics of the layer of the body with shape `betas` (10,)."""
    vertices = shaped_vertices(data, betas[None])[0]
    thickness_m = flesh_thickness_m(data, vertices)
    share = thickness_m / _THICKEST_M
    shortest, longest = _RELAXATION_S
    return LayerParameters(
        frequency_hz=_SHEAR_SPEED_M_S / (4 * thickness_m),
        thickness_m=thickness_m,
        normals=vertex_normals(vertices, data.faces),
        relaxation_s=shortest + share * (longest - shortest),
        # At the layer's own stiffness w^2 this couples over its thickness: D = w^2 h^4.
        bending_m4_s2=(np.pi / 2 * _SHEAR_SPEED_M_S * thickness_m) ** 2,
        free=thickness_m >= _HELD_BELOW_M,
    )


def flesh_thickness_m(data: BodyModelData, vertices: Array) -> Array:
    """(V,) thickness of the flesh of a shaped body (V, 3), metres."""
    flesh = data.weights @ (_of_segments(0) * segment_radii_m(data, vertices))
    standing_out = np.clip(1 + prominence_m(vertices, data.faces) / _PROMINENT_M, *_PROMINENCE)
    corpulence = corpulence_kg_m2(vertices, data.faces) / _USUAL_CORPULENCE_KG_M2
    spread = _spread(flesh * standing_out * corpulence, vertices, data.faces, _SPREADING_M)
    # Nothing is infinitely thin; what is this thin is held.
    return np.clip(spread, _HELD_BELOW_M / 2, _THICKEST_M)


def muscle_share(data: BodyModelData) -> Array:
    """(V,) share of muscle in the flesh."""
    return data.weights @ _of_segments(1)


def segment_radii_m(data: BodyModelData, vertices: Array) -> Array:
    """(24,) radius of each segment, from girth: its skin's area over its length, over 2 pi.

    The length is that of a cylinder whose skin is spread along the bone as the segment's is. A
    segment without a bone beyond it (hands, feet's ends, head) has radius 0.
    """
    areas, joints = vertex_areas_m2(vertices, data.faces), data.J_regressor @ vertices
    radii_m = np.zeros(len(joints))
    for joint in range(len(joints)):
        beyond = np.flatnonzero(data.parents == joint)
        if not len(beyond):
            continue
        # Where the body forks, along its middle.
        bones = joints[beyond] - joints[joint]
        bone = bones[np.abs(bones[:, 0]).argmin()]
        along = vertices @ bone / np.linalg.norm(bone)
        skin = areas * data.weights[:, joint]
        length_m = np.sqrt(12 * np.cov(along, aweights=skin, ddof=0))
        radii_m[joint] = skin.sum() / length_m / (2 * np.pi)
    return radii_m


def corpulence_kg_m2(vertices: Array, faces: np.ndarray) -> float:
    """Mass over squared height."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    volume_m3 = (a * np.cross(b, c)).sum() / 6
    return float(_DENSITY_KG_M3 * volume_m3 / np.ptp(vertices[:, 1]) ** 2)


def prominence_m(vertices: Array, faces: np.ndarray) -> Array:
    """(V,) how far each vertex stands out of the rounded body more than its surroundings, m.

    Rounding shrinks every limb, a thin one most; the surroundings tell by how much.
    """
    rounded = _spread(vertices, vertices, faces, _ROUNDING_M)
    standing = ((vertices - rounded) * vertex_normals(vertices, faces)).sum(1)
    return standing - _spread(standing, vertices, faces, 2 * _ROUNDING_M)


def _of_segments(column: int) -> Array:
    names = [name.split("_")[-1] for name in SMPL_JOINT_NAMES]
    return np.array([_FLESH_AND_MUSCLE.get(name, (0.0, 0.0))[column] for name in names])


def _spread(values: Array, vertices: Array, faces: np.ndarray, length_m: float) -> Array:
    """Two steps of implicit diffusion over `length_m` in all; values (V,) or (V, n)."""
    mass = sp.diags(vertex_areas_m2(vertices, faces))
    system = sp.csc_matrix(mass + length_m**2 / 2 * cotangent_laplacian(vertices, faces))
    solver = splu(system)
    return solver.solve(mass @ solver.solve(mass @ values))
