"""A helper rig for any SMPL body: tips on the flesh, each with a bone that carries it.

Rigs of helper bones are made by hand. This one follows from the template: tips are spread evenly
over the half of the skin that lies farthest from any bone, without head, hands and feet.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra

from bridge.body import BodyModelData
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.posing import joint_rotations, joint_transforms, shaped_joints, shaped_vertices
from bridge.motion import unpack_theta
from bridge.tissue.nodes import farthest_points
from bridge.tissue.shape import distance_to_bones_m

_BONY = ("head", "ankle", "foot", "wrist", "hand")
_LEAST_SHARE = 1e-12


@dataclass(frozen=True, eq=False)
class HelperRig:
    """H helper bones among the V vertices of a body model."""

    tips: NDArray[np.int64]
    """(H,) vertices at the helpers' tips."""
    parents: NDArray[np.int64]
    """(H,) joints whose bones carry them: those of the largest skinning weight."""
    shares: NDArray[np.float64]
    """(V, H) by which tips a vertex goes, by distance along the skin; rows sum to 1."""
    flesh: NDArray[np.float64]
    """(V,) distance to the bone relative to the tips' mean; 0 on head, hands and feet."""

    def weights(self, power: float) -> NDArray[np.float64]:
        """(V, H) skinning weights: shares, as far as there is flesh."""
        return self.shares * self.flesh[:, None] ** power


def helper_rig(body: BodyModelData, count: int) -> HelperRig:
    """Spread `count` helpers over the flesh of a body's template."""
    template = np.asarray(body.v_template, np.float64)
    depth_m = distance_to_bones_m(template, body.J_regressor @ template, body.parents)
    carriers = body.weights.argmax(axis=1)
    bony = np.isin(carriers, [j for j, n in enumerate(SMPL_JOINT_NAMES) if n.endswith(_BONY)])
    fleshy = np.flatnonzero((depth_m > np.median(depth_m)) & ~bony)
    tips = fleshy[farthest_points(template[fleshy], count)]
    along_m = _along_skin_m(template, body.faces, tips)
    spacing_m = np.sort(along_m[tips], axis=1)[:, 1].mean()
    shares = np.exp(-2 * (along_m / spacing_m) ** 2) + _LEAST_SHARE * np.exp(-along_m)
    flesh = np.where(bony, 0.0, depth_m / depth_m[tips].mean())
    return HelperRig(tips, carriers[tips], shares / shares.sum(axis=1, keepdims=True), flesh)


def carried_by_skeleton(
    rig: HelperRig, body: BodyModelData, betas: NDArray, theta: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Joints (T, 24, 3) and tips (T, H, 3) where the skeleton alone has them, metres."""
    pose, trans = unpack_theta(np.asarray(theta, np.float64))
    shape = np.asarray(betas, np.float64)[None]
    joints, rest = shaped_joints(body, shape), shaped_vertices(body, shape)[0, rig.tips]
    rotations = joint_rotations(body, pose)
    bones = joint_transforms(rotations, joints.repeat(len(pose), 0), body.parents, trans)
    return _moved(bones, joints[0]), _moved(bones[:, rig.parents], rest)


def _moved(transforms: NDArray, points: NDArray) -> NDArray[np.float64]:
    return np.einsum("thxy,hy->thx", transforms[..., :3, :3], points) + transforms[..., :3, 3]


def _along_skin_m(vertices: NDArray, faces: NDArray, sources: NDArray) -> NDArray[np.float64]:
    """(V, H) distance along the mesh's edges."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    graph = sp.csr_matrix((lengths, tuple(edges.T)), shape=(len(vertices),) * 2)
    distances = dijkstra(graph, directed=False, indices=sources).T
    return np.where(np.isfinite(distances), distances, distances[np.isfinite(distances)].max())
