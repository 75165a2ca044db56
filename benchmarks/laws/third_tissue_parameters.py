"""How a body's shape gives the mechanics of the third tissue law.

Fat is what a person has more than the same person would have lean: along the direction of betas in
which volume / height^2 grows fastest, the body is put to a lean value, and how far the skin stands
out from there (less how far the bones moved) is fat, on top of a lean person's skinfold. All else
follows from moduli of materials: a layer of thickness h and shear modulus G has G / h per area,
and half its mass moves with either side. So frequencies go about as 1 / h: fat on firm muscle
swings with 4.5 Hz at 6 cm and with 9 Hz at 3 cm.

A person's firmness and damping, as age and training give them, come of a hash of the betas.
"""

from __future__ import annotations

import zlib

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from benchmarks.laws.third_tissue import ThirdTissueParameters
from bridge.body import BodyModelData
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.posing import shaped_joints, shaped_vertices
from bridge.body.surface_operators import (
    cotangent_laplacian,
    vertex_areas_m2,
    vertex_normals,
    volume_m3,
)
from dsnet.synthetic.tissue_parameters import smooth_over_surface

Array = NDArray[np.floating]

# A lean woman's fat, and muscle that moves over the bone, by the joint that moves the segment.
_LEAN_FAT_M = {
    "pelvis": 0.012, "hip": 0.012, "knee": 0.007, "spine1": 0.010, "spine2": 0.008,
    "spine3": 0.007, "neck": 0.004, "collar": 0.006, "shoulder": 0.007, "elbow": 0.004,
}  # fmt: skip
_MUSCLE_M = {
    "pelvis": 0.035, "hip": 0.040, "knee": 0.025, "spine1": 0.015, "spine2": 0.015,
    "spine3": 0.015, "neck": 0.010, "collar": 0.020, "shoulder": 0.025, "elbow": 0.015,
}  # fmt: skip
# Men have thinner skinfolds, and much of what swells them lies behind the muscle.
_MALE_FAT_SHARE = 0.65
# Joints where skin lies on bone, and from how near to how far from their centres.
_BONY_JOINTS, _BONY_M = ("knee", "elbow", "wrist", "ankle"), (0.06, 0.16)
_LEAN_DEVIATIONS = -2.5
_SKIN_M, _LEAST_FAT_M, _LEAST_MUSCLE_M = 0.002, 0.003, 0.008
_SMOOTH_M = 0.015
# Held where less than this share of the tissue is left.
_HELD_SHARE = 0.05

_SKIN_KG_M3, _FAT_KG_M3, _MUSCLE_KG_M3 = 1100.0, 930.0, 1060.0
_FAT_PA, _MUSCLE_PA = 1500.0, 16_000.0
# Against shear: pressed and pulled fat, and muscle across its fibres.
_PRESSED, _PULLED, _MUSCLE_ACROSS = 4.0, 2.0, 2.0
# Shear at which fat is e times as stiff.
_REACH = 0.5
_FAT_DAMPING, _MUSCLE_DAMPING = 0.2, 0.2
_QUADRATIC_SPEED_M_S = 1.0
_FIRMNESS, _DAMPING = (0.85, 1.15), (0.8, 1.2)
# Skin of 20 kPa and 2 mm, over the square of the neighbourhood's length.
_NEIGHBOURHOOD_M = 0.03
_SKIN_SHEAR_N_M3 = 20_000 * _SKIN_M / _NEIGHBOURHOOD_M**2
# Of a bonded incompressible layer, as a multiple of G / h, and its bound as a frequency.
_VOLUME, _VOLUME_HZ = 12.0, 16.0


def third_tissue_parameters(
    data: BodyModelData, betas: Array
) -> tuple[NDArray[np.int64], ThirdTissueParameters]:
    """Vertices (N,) that are not held, and their mechanics, of a body with betas (10,)."""
    vertices, share = shaped_vertices(data, betas[None])[0], free_share(data, betas)
    free = np.flatnonzero(share > _HELD_SHARE)
    fat_m = _LEAST_FAT_M + (share * fat_depths_m(data, betas))[free]
    muscle_m = _LEAST_MUSCLE_M + (share * _by_segment(data, _MUSCLE_M))[free]
    firmness, damping = _person(betas)
    skin = _SKIN_KG_M3 * _SKIN_M + _FAT_KG_M3 * fat_m / 2
    muscle = (_FAT_KG_M3 * fat_m + _MUSCLE_KG_M3 * muscle_m) / 2
    along, tone = firmness * _FAT_PA / fat_m, firmness * _MUSCLE_PA / muscle_m
    laplacian = sp.csr_matrix(cotangent_laplacian(vertices, data.faces)[free][:, free])
    return free, ThirdTissueParameters(
        axes=_axes(vertex_normals(vertices, data.faces)[free]),
        areas_m2=vertex_areas_m2(vertices, data.faces)[free],
        laplacian=laplacian,
        skin_kg_m2=skin,
        muscle_kg_m2=muscle,
        fat_depth_m=fat_m,
        fat_along_n_m3=along,
        fat_pulled_n_m3=_PULLED * along,
        fat_pressed_n_m3=_PRESSED * along,
        fat_reach_m=_REACH * fat_m,
        fat_damping_ns_m3=2 * _FAT_DAMPING * damping * np.sqrt(along * skin),
        muscle_n_m3=tone * np.array([_MUSCLE_ACROSS, 1.0, 1.0])[:, None],
        muscle_damping_ns_m3=2 * _MUSCLE_DAMPING * damping * np.sqrt(tone * muscle),
        volume_n_m3=np.minimum(_VOLUME * along, skin * (2 * np.pi * _VOLUME_HZ) ** 2),
        shear_n_m3=_SKIN_SHEAR_N_M3,
        neighbourhood_m=_NEIGHBOURHOOD_M,
        quadratic_speed_m_s=_QUADRATIC_SPEED_M_S,
    )


def fat_depths_m(data: BodyModelData, betas: Array) -> Array:
    """(V,) a lean person's fat and how far this body's skin stands out from its lean self's."""
    lean = lean_betas(data, betas)
    vertices = shaped_vertices(data, np.stack([betas, lean]))
    moved = vertices[0] - vertices[1] - _carried(data, betas, lean)
    swelling = (moved * vertex_normals(vertices[1], data.faces)).sum(1)
    smooth = smooth_over_surface(swelling[:, None], vertices[0], data.faces, _SMOOTH_M)[:, 0]
    share = _MALE_FAT_SHARE if data.gender == "male" else 1.0
    return share * (_by_segment(data, _LEAN_FAT_M) + np.maximum(smooth, 0))


def lean_betas(data: BodyModelData, betas: Array) -> Array:
    """(10,) the same person lean: what of betas makes volume / height^2 put to a lean value."""
    steps = np.eye(len(betas)) / 2
    up, down = (shaped_vertices(data, sign * steps) for sign in (1, -1))
    growth = np.array(
        [_stoutness(data, a) - _stoutness(data, b) for a, b in zip(up, down, strict=True)]
    )
    direction = growth / np.linalg.norm(growth)
    return betas - (betas @ direction - _LEAN_DEVIATIONS) * direction


def free_share(data: BodyModelData, betas: Array) -> Array:
    """(V,) 0 on head, hands, feet and where skin lies on bone; 1 where flesh moves freely."""
    fleshy = [_segment(name) in _LEAN_FAT_M for name in SMPL_JOINT_NAMES]
    share = _smoothstep((data.weights[:, fleshy].sum(1) - 0.5) * 2)
    vertices, joints = shaped_vertices(data, betas[None])[0], shaped_joints(data, betas[None])[0]
    near, far = _BONY_M
    for joint, name in zip(joints, SMPL_JOINT_NAMES, strict=True):
        if _segment(name) in _BONY_JOINTS:
            distance = np.linalg.norm(vertices - joint, axis=1)
            share = share * _smoothstep((distance - near) / (far - near))
    return share


def _carried(data: BodyModelData, betas: Array, lean: Array) -> Array:
    """(V, 3) how far a vertex is carried by its bones, linearly along each, from lean to betas."""
    joints, before = shaped_joints(data, np.stack([betas, lean]))
    shifts, vertices = joints - before, shaped_vertices(data, lean[None])[0]
    carried = data.weights @ shifts
    for joint, parent in enumerate(data.parents):
        # Bones of one child are limbs; trunk and hands go with their joint.
        if _segment(SMPL_JOINT_NAMES[joint]) not in ("knee", "ankle", "elbow", "wrist"):
            continue
        bone = before[joint] - before[parent]
        along = np.clip((vertices - before[parent]) @ bone / (bone @ bone), 0, 1)
        weight = (data.weights[:, parent] * along)[:, None]
        carried = carried + weight * (shifts[joint] - shifts[parent])
    return carried


def _person(betas: Array) -> tuple[float, float]:
    """Firmness and damping of a person, of a hash of the betas."""
    code = zlib.crc32((np.asarray(betas, np.float32) + np.float32(0)).tobytes())
    shares = (code & 0xFFFF) / 0xFFFF, (code >> 16) / 0xFFFF
    low, high = np.array([_FIRMNESS, _DAMPING]).T
    firmness, damping = low + (high - low) * np.array(shares)
    return float(firmness), float(damping)


def _stoutness(data: BodyModelData, vertices: Array) -> float:
    return volume_m3(vertices, data.faces) / float(np.ptp(vertices[:, 1])) ** 2


def _by_segment(data: BodyModelData, table: dict[str, float]) -> Array:
    """(V,) a table's values, blended as the skin is; 0 for segments that it lacks."""
    return data.weights @ np.array([table.get(_segment(name), 0.0) for name in SMPL_JOINT_NAMES])


def _segment(joint: str) -> str:
    return joint.removeprefix("left_").removeprefix("right_")


def _axes(normals: Array) -> Array:
    """(3, 3, N) the normals (N, 3) and two tangents of each, as columns of a rotation."""
    least = np.eye(3)[np.abs(normals).argmin(1)]
    first = np.cross(normals, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([normals, first, np.cross(normals, first)], axis=-1).transpose(1, 2, 0)


def _smoothstep(share: Array) -> Array:
    share = np.clip(share, 0, 1)
    return share**2 * (3 - 2 * share)
