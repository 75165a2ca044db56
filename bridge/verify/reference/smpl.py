"""SMPL's gradient, written with forces and torques; its forward pass is `bridge.body.posing`.

Take the gradient by the posed vertices as forces on them. What a parameter does is then
mechanics: a translation collects the force, a joint's turn the torque about that joint of all
that hangs on it, and the rest pose feels the forces turned back by the skinning.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bridge.body import BodyModelData, pose_vertices, unpose_vertices
from bridge.body.posing import joint_rotations, joint_transforms, rest_vertices, shaped_joints

Arrays = dict[str, np.ndarray]
_SERIES_BELOW = 1e-2
"""Angle (rad) below which the closed forms cancel and three terms of the series are exact."""


@dataclass(frozen=True)
class Bodies:
    """B bodies in B poses."""

    data: BodyModelData
    """The body model."""
    betas: np.ndarray
    """(B, 10)."""
    pose: np.ndarray
    """(B, 22, 3) or (B, 24, 3), radians."""
    trans: np.ndarray
    """(B, 3), metres."""
    offsets: np.ndarray
    """(B, V, 3), metres, in the rest pose."""


def forward(bodies: Bodies, mesh: np.ndarray) -> Arrays:
    """What SMPL computes on the way to its vertices, and the rest pose of `mesh` (B, V, 3)."""
    data, betas, pose, trans = bodies.data, bodies.betas, bodies.pose, bodies.trans
    return {
        "rotations": joint_rotations(data, pose),
        "joints": shaped_joints(data, betas),
        "rest_vertices": rest_vertices(data, betas, pose),
        "vertices": pose_vertices(data, betas, pose, trans, bodies.offsets),
        "unposed": unpose_vertices(data, mesh, betas, pose, trans),
    }


def gradient(bodies: Bodies, probe: np.ndarray) -> Arrays:
    """Gradient of sum(probe * vertices) by betas, pose, trans and offsets; probe (B, V, 3)."""
    single = [_gradient_of_one(bodies, row, probe[row]) for row in range(len(probe))]
    return {name: np.stack([one[name] for one in single]) for name in single[0]}


def _gradient_of_one(bodies: Bodies, row: int, force: np.ndarray) -> Arrays:
    data, one = bodies.data, slice(row, row + 1)
    rotations = joint_rotations(data, bodies.pose[one])
    joints = shaped_joints(data, bodies.betas[one])
    T_world_rest = joint_transforms(rotations, joints, data.parents, bodies.trans[one])[0]
    turn, shift, joints = T_world_rest[:, :3, :3], T_world_rest[:, :3, 3], joints[0]
    rest = rest_vertices(data, bodies.betas[one], bodies.pose[one])[0] + bodies.offsets[row]

    bone_force = data.weights.T @ force  # (24, 3) what each bone receives
    place = np.einsum("jxy,vy->jvx", turn, rest) + shift[:, None]  # every vertex by every bone
    bone_torque = np.einsum("vj,jvx->jx", data.weights, np.cross(place, force))  # about the origin
    force_below, torque_below = _with_descendants(data.parents, bone_force, bone_torque)
    joint_place = np.einsum("jxy,jy->jx", turn, joints) + shift
    torque = torque_below - np.cross(joint_place, force_below)

    rest_force = np.einsum("vj,jyx,vy->vx", data.weights, turn, force)
    rotation_force = np.einsum("vx,vxp->p", rest_force, data.posedirs).reshape(-1, 3, 3)
    joint_force = _by_joints(data.parents, turn, bone_force, force_below)
    shape_force = rest_force + data.J_regressor.T @ joint_force
    pose = bodies.pose[row]
    by_pose = [
        _by_axis_angle(
            pose[joint],
            np.eye(3) if joint == 0 else turn[data.parents[joint]],
            torque[joint],
            rotations[0, joint],
            np.zeros((3, 3)) if joint == 0 else rotation_force[joint - 1],
        )
        for joint in range(len(pose))
    ]
    return {
        "betas": np.einsum("vx,vxs->s", shape_force, data.shapedirs),
        "pose": np.array(by_pose),
        "trans": force.sum(axis=0),
        "offsets": rest_force,
    }


def _with_descendants(parents: np.ndarray, *values: np.ndarray) -> list[np.ndarray]:
    """Sums (24, 3) over each joint and everything that hangs on it."""
    sums = [value.copy() for value in values]
    for joint in range(len(parents) - 1, 0, -1):
        for total in sums:
            total[parents[joint]] += total[joint]
    return sums


def _by_joints(
    parents: np.ndarray, turn: np.ndarray, bone_force: np.ndarray, force_below: np.ndarray
) -> np.ndarray:
    """Gradient (24, 3) by the rest pose's joints: where bones begin, and about what they turn."""
    result = -np.einsum("jyx,jy->jx", turn, bone_force)
    result[0] += force_below[0]
    for joint, parent in enumerate(parents):
        if parent >= 0:
            result[joint] += turn[parent].T @ force_below[joint]
            result[parent] -= turn[parent].T @ force_below[joint]
    return result


def _by_axis_angle(
    vector: np.ndarray,
    turn_of_parent: np.ndarray,
    torque: np.ndarray,
    rotation: np.ndarray,
    rotation_force: np.ndarray,
) -> np.ndarray:
    """Gradient (3,) by one joint's axis-angle vector: skinning and pose blend shapes."""
    # Column k: the turn, in the parent's frame, that a change of component k makes.
    axes = left_jacobian(vector)
    by_turn = axes.T @ turn_of_parent.T @ torque
    by_blend = [np.sum(rotation_force * (cross_matrix(axis) @ rotation)) for axis in axes.T]
    return by_turn + by_blend


def left_jacobian(vector: np.ndarray) -> np.ndarray:
    """J (3, 3) with exp(v + dv) = exp(J dv) exp(v) to first order, for a vector v in radians."""
    angle = np.linalg.norm(vector)
    cross = cross_matrix(vector)
    if angle < _SERIES_BELOW:
        square = angle**2
        versine = 1 / 2 - square / 24 + square**2 / 720
        rest = 1 / 6 - square / 120 + square**2 / 5040
    else:
        versine = 2 * np.sin(angle / 2) ** 2 / angle**2
        rest = (angle - np.sin(angle)) / angle**3
    return np.eye(3) + versine * cross + rest * cross @ cross


def cross_matrix(vector: np.ndarray) -> np.ndarray:
    """Matrix whose product with b is the cross product of `vector` (3,) and b."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
