"""Forward kinematics of a joint tree and its gradient, written out by hand.

The derivatives by a joint are sums of forces and torques over its subtree, as in rigid-body
mechanics. Let G = [G_R g] be the derivatives by T_world_rest = [R t] of one bone. A small rotation
w about the world's origin changes R by w x R and t by w x t, so the distance by w . (sum of columns
R_i x G_i + t x g): the bone's torque about the origin; g is its force. Rotating a joint moves its
whole subtree about the joint's position p instead of the origin, by the torque
(sum of torques) - p x (sum of forces).

Vectors and matrices of bones have components first, (3, B, J) and (3, 3, B, J), so that each
operation runs over all joints of the batch at once: PyTorch is far slower on many 3 x 3 matrices.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from torch_align_ae.body.smpl import subtree_matrix

# A squared angle below this changes no coefficient of a rotation by more than float64's rounding
# of the rotation.
_SMALLEST_SQUARED = 1e-8


class Bones(NamedTuple):
    """Transforms of the bones of a batch, J joints each."""

    jacobian: Tensor  # (3, 3, B, J) turn in the parent's frame by a change of the axis-angle vector
    pose_features: Tensor  # (3, 3, B, J) R - I, R being the rotation in the parent's frame
    T_world_joint: Tensor  # (3, 4, B, J + 1); the last is the world itself
    T_world_rest: Tensor  # (3, 4, B, J) from the rest pose to the posed body


class JointTree:
    """A tree of J joints, parents before children; `parents[0]` is -1."""

    def __init__(self, parents: tuple[int, ...], dtype: torch.dtype) -> None:
        world = len(parents)
        above = [world, *parents[1:], world]
        self._above = torch.tensor(above)
        # In each round every frame is multiplied by that of another joint, until all are relative
        # to the world. A round doubles the number of joints between a frame and its reference.
        self._rounds = []
        while set(above) != {world}:
            self._rounds.append(torch.tensor(above))
            above = [above[joint] for joint in above]
        self._subtree = subtree_matrix(parents).to(dtype)
        self._identity = torch.eye(3, dtype=dtype)[:, :, None, None]

    def move(self, joints: Tensor, pose: Tensor, trans: Tensor) -> Bones:
        """Bones of pose (B, J, 3), radians, trans (B, 3) and joints at rest (B, J, 3), metres."""
        joints = joints.permute(2, 0, 1)
        jacobian, pose_features = self._turns(pose.permute(2, 0, 1).contiguous())
        frames = pose_features.new_zeros(3, 4, len(pose), len(self._above))
        turn, place = frames[:, :3], frames[:, 3]
        turn[..., :-1] = pose_features
        turn += self._identity
        place[..., 0] = trans.T
        place[..., :-1] += joints
        place[..., 1:-1] -= joints.index_select(2, self._above[1:-1])
        for above in self._rounds:
            before = frames.index_select(3, above)
            frames = (before[:, :3, None] * frames).sum(1)
            frames[:, 3] += before[:, 3]
        rest = frames[..., :-1].clone()
        rest[:, 3] -= (rest[:, :3] * joints).sum(1)
        return Bones(jacobian, pose_features, frames, rest)

    def gradient(
        self, bones: Bones, by_transforms: Tensor, by_pose_features: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Derivatives by pose (B, J, 3), trans (B, 3) and joints in the rest pose (B, J, 3).

        They follow from those by `T_world_rest` and by the `pose_features` (3, 3, B, J - 1) of all
        joints but the root.
        """
        turn, place = bones.T_world_joint[:, :3], bones.T_world_joint[:, 3, :, :-1]
        above = turn.index_select(3, self._above[:-1])
        torque = _moment(bones.T_world_rest, by_transforms)
        force, torque = (torch.stack([by_transforms[:, 3], torque]) @ self._subtree.T).unbind()
        torque -= torch.linalg.cross(place, force, dim=0)
        spin = _transposed_times(above, torque)
        rotation = bones.pose_features[..., 1:] + self._identity
        spin[..., 1:] += _moment(rotation, by_pose_features)
        joints = _transposed_times(above - turn[..., :-1], force)
        pose = _transposed_times(bones.jacobian, spin)
        return pose.permute(1, 2, 0), force[..., 0].T, joints.permute(1, 2, 0)

    def _turns(self, axis_angle: Tensor) -> tuple[Tensor, Tensor]:
        """Left Jacobians (3, 3, ...) and R - I of axis-angle vectors (3, ...): Rodrigues' formula.

        exp(v + dv) = exp(J dv) exp(v) to first order, J being the left Jacobian.
        """
        squared = axis_angle.square().sum(0)
        safe = squared.clamp_min(_SMALLEST_SQUARED)
        angle = safe.sqrt()
        sine = torch.sin(angle) / angle
        # (1 - cos a) / a^2 by the half angle, because 1 - cos a cancels.
        versine = 2 * (torch.sin(angle / 2) / angle).square()
        x, y, z = axis_angle
        zero = torch.zeros_like(x)
        cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero]).unflatten(0, (3, 3))
        twice = axis_angle[:, None] * axis_angle - squared * self._identity
        jacobian = self._identity + versine * cross + (1 - sine) / safe * twice
        return jacobian, sine * cross + versine * twice


def _transposed_times(matrix: Tensor, vector: Tensor) -> Tensor:
    return (matrix * vector[:, None]).sum(0)


def _moment(arms: Tensor, forces: Tensor) -> Tensor:
    """Sum over columns (3, n, ...) of arm x force."""
    return torch.linalg.cross(arms, forces, dim=0).sum(1)
