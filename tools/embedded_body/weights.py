"""Smooth skinning weights: the rig's jump by half from one vertex to the next.

They are spread over the surface as heat would, farther at wide joints than at narrow ones.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from bridge.body.model_data import JOINT_COUNT, SMPL_JOINT_NAMES
from bridge.body.surface_operators import cotangent_laplacian, vertex_areas_m2
from tools.embedded_body.symmetry import MIRRORED_JOINT, symmetric_weights

# How far heat spreads, metres, where a joint alone moves the skin.
_SPREAD_M = {
    "pelvis": 0.034, "hip": 0.034, "spine1": 0.034, "spine2": 0.034, "spine3": 0.03, "collar": 0.03,
    "shoulder": 0.024, "neck": 0.025, "knee": 0.024, "elbow": 0.014, "ankle": 0.018, "wrist": 0.013,
}  # fmt: skip
_ELSEWHERE_M = 0.006
_STEPS = 4
# So far beyond the midline the skin follows the other side's joints, ever less.
_MIDLINE_HALF_WIDTH_M = 0.045


def smooth_weights(
    weights: np.ndarray, vertices: np.ndarray, faces: np.ndarray, mirror: np.ndarray
) -> np.ndarray:
    """Weights (V, 24), symmetric as the body (V, 3) is; rows sum to one."""
    names = [name.split("_")[-1] for name in SMPL_JOINT_NAMES]
    spread_m = weights @ [_SPREAD_M.get(name, _ELSEWHERE_M) for name in names]
    # Several implicit steps leave no long tails behind, as one would.
    step_m2 = spread_m**2 / (2 * _STEPS)
    flow = sp.eye(len(vertices)) + sp.diags(step_m2) @ _heat_flow(vertices, faces)
    solver = splu(sp.csc_matrix(flow))
    for _ in range(_STEPS):
        weights = solver.solve(weights)
    side = np.sign(MIRRORED_JOINT - np.arange(JOINT_COUNT))
    beyond = vertices[:, :1] * side / _MIDLINE_HALF_WIDTH_M
    weights = symmetric_weights(np.maximum(weights, 0.0) * np.clip(1.0 + beyond, 0.0, 1.0), mirror)
    return weights / weights.sum(axis=1, keepdims=True)


def _heat_flow(vertices: np.ndarray, faces: np.ndarray) -> sp.csr_matrix:
    """The Laplacian (V, V), per square metre, without the flow uphill over obtuse corners."""
    between = -cotangent_laplacian(vertices, faces)
    between.setdiag(0.0)
    between = between.maximum(0.0)
    total = np.asarray(between.sum(axis=1)).ravel()
    per_area = sp.diags(1.0 / vertex_areas_m2(vertices, faces))
    return (per_area @ (sp.diags(total) - between)).tocsr()
