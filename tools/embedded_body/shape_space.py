"""Shape blend shapes by PCA, and a sparse linear joint regressor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bridge.body.model_data import JOINT_COUNT, SHAPE_COUNT, SMPL_PARENTS
from tools.embedded_body.symmetry import MIRRORED_JOINT, symmetric_points

REGRESSOR_VERTEX_COUNT = 96
_REGRESSOR_RIDGE = 1e-7
_ACROSS_PREFERENCE = 1.0


@dataclass(frozen=True)
class ShapeSpace:
    """A linear model of the sampled bodies."""

    template: np.ndarray
    """(V, 3) mean body, metres."""
    shapedirs: np.ndarray
    """(V, 3, 10) displacement per standard deviation of each component."""
    betas: np.ndarray
    """(N, 10) the samples' coefficients, of unit variance."""
    explained: float
    """Share of the samples' variance that the 10 components hold."""
    residual_m: np.ndarray
    """(N, V) distance of each sample's vertices from their reconstruction."""


def fit_shape_space(bodies: np.ndarray, mirror: np.ndarray) -> ShapeSpace:
    """PCA of symmetric bodies (N, V, 3); signs such that each beta grows with volume or stature.

    A component's sign is arbitrary; here +beta means a taller body, or, for components that
    hardly change stature, a wider one.
    """
    count = len(bodies)
    template = symmetric_points(bodies.mean(axis=0), mirror)
    deviations = (bodies - template).reshape(count, -1)
    left, singular, right = np.linalg.svd(deviations, full_matrices=False)
    scale = singular[:SHAPE_COUNT] / np.sqrt(count)
    directions = (right[:SHAPE_COUNT] * scale[:, None]).reshape(SHAPE_COUNT, -1, 3)
    directions = symmetric_points(directions, mirror)
    signs = np.array([_sign(template, direction) for direction in directions])
    directions = directions * signs[:, None, None]
    betas = left[:, :SHAPE_COUNT] * np.sqrt(count) * signs
    residual = deviations - betas @ directions.reshape(SHAPE_COUNT, -1)
    return ShapeSpace(
        template=template,
        shapedirs=np.moveaxis(directions, 0, -1),
        betas=betas,
        explained=float((singular[:SHAPE_COUNT] ** 2).sum() / (singular**2).sum()),
        residual_m=np.linalg.norm(residual.reshape(count, -1, 3), axis=-1),
    )


def _sign(template: np.ndarray, direction: np.ndarray) -> float:
    stature_change = np.ptp((template + direction)[:, 1]) - np.ptp(template[:, 1])
    width_change = (np.abs(template + direction) - np.abs(template))[:, [0, 2]].sum()
    decisive = stature_change if abs(stature_change) > 0.01 else width_change
    return 1.0 if decisive >= 0 else -1.0


@dataclass(frozen=True)
class JointRegressor:
    """Joints as signed sums of the vertices around them."""

    vertex: np.ndarray
    """(24, R) vertices of each joint's ring."""
    value: np.ndarray
    """(24, R) their weights; rows sum to one."""

    def __call__(self, vertices: np.ndarray) -> np.ndarray:
        """(..., 24, 3) joints of (..., V, 3) rest-pose bodies."""
        return np.einsum("...jrx,jr->...jx", vertices[..., self.vertex, :], self.value)


def fit_joint_regressor(
    shapes: ShapeSpace, joints: np.ndarray, weights: np.ndarray, mirror: np.ndarray
) -> JointRegressor:
    """Fit each joint's ring to what the joints do over the shape space.

    The joints are nearly affine in betas (the worst, a hip, is 2 mm off in the mean), so a ring
    must meet 33 conditions: the mean joint and its change with each beta. The solution nearest
    to the plain mean of the ring is taken. Its weights are signed: no convex sum follows a knee,
    which the calf's growth leaves where it is. They sum to one, so that translation carries over.
    """
    design = np.c_[np.ones(len(joints)), shapes.betas]
    affine = np.linalg.lstsq(design, joints.reshape(len(joints), -1), rcond=None)[0]
    affine = affine.reshape(-1, JOINT_COUNT, 3)
    basis = np.concatenate([shapes.template[..., None], shapes.shapedirs], axis=-1)
    rings = np.zeros((JOINT_COUNT, REGRESSOR_VERTEX_COUNT), dtype=int)
    values = np.zeros(rings.shape)
    for joint, twin in enumerate(MIRRORED_JOINT):
        if twin < joint:
            rings[joint], values[joint] = mirror[rings[twin]], values[twin]
            continue
        ring = _ring(shapes.template, affine[0], weights, joint)
        if twin == joint:
            ring = ring[np.isin(mirror[ring], ring)]
        value = _nearest_to_mean(basis[ring], affine[:, joint].T)
        if twin == joint:
            value = (value + value[np.searchsorted(ring, mirror[ring])]) / 2
        # Where one vertex lost its twin, the first one comes again with nothing.
        rings[joint], values[joint, : len(ring)] = ring[0], value
        rings[joint, : len(ring)] = ring
    return JointRegressor(rings, values)


def _ring(template: np.ndarray, joints: np.ndarray, weights: np.ndarray, joint: int) -> np.ndarray:
    """Vertices that the joint or its parent moves, near the plane across the bone."""
    parent = max(SMPL_PARENTS[joint], 0)
    moved = np.flatnonzero((weights[:, joint] > 0.02) | (weights[:, parent] > 0.5))
    children = [child for child, of in enumerate(SMPL_PARENTS) if of == joint]
    bone = (
        joints[children].mean(axis=0) - joints[joint]
        if children
        else joints[joint] - joints[parent]
    )
    offset = template[moved] - joints[joint]
    along = np.abs(offset @ bone) / np.linalg.norm(bone)
    score = np.linalg.norm(offset, axis=1) + _ACROSS_PREFERENCE * along
    return np.sort(moved[np.argsort(score, kind="stable")[:REGRESSOR_VERTEX_COUNT]])


def _nearest_to_mean(basis: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Weights (R,), of sum one, with `weights @ basis = target` and least distance to the mean.

    Parameters
    ----------
    basis : (R, 3, 11) the ring's mean vertices and their changes with each beta.
    target : (3, 11) the same of the joint.
    """
    count = len(basis)
    mean = np.full(count, 1.0 / count)
    conditions = basis.reshape(count, -1).T
    residual = target.reshape(-1) - conditions @ mean
    # Centred conditions make corrections that sum to zero.
    centred = conditions - conditions.mean(axis=1, keepdims=True)
    # The ridge bounds the weights where the conditions almost contradict each other.
    system = conditions @ centred.T + _REGRESSOR_RIDGE * np.eye(len(conditions))
    return mean + centred.T @ np.linalg.solve(system, residual)
