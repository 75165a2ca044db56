"""Bones in motion, and the gradient of what they carry, written out by hand.

A joint feels the force and the torque of everything that hangs on it, as in rigid-body
mechanics. Let G = [G_R g] be the derivatives by T_world_rest = [R t] of one bone. A small turn w
about the world's origin changes R by w x R and t by w x t, so the distance by w . (sum of columns
R_i x G_i + t x g): the bone's torque about the origin; g is its force. Turning a joint moves its
whole subtree, and about the joint's own place p instead of the origin: the torque there is
(sum of torques) - p x (sum of forces).

Vectors and matrices of bones stand component first, (3, B, J) and (3, 3, B, J), so that each
operation runs over all joints of the batch in one sweep: on matrices of 3 x 3 side by side PyTorch
takes far longer.
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
    """Bones of a batch in motion, J joints each."""

    jacobian: Tensor  # (3, 3, B, J) turn in the parent's frame by a change of the axis-angle vector
    pose_features: Tensor  # (3, 3, B, J) R - I, R being the rotation in the parent's frame
    T_world_joint: Tensor  # (3, 4, B, J + 1); the last is the world's own frame
    T_world_rest: Tensor  # (3, 4, B, J) where a bone carries its skin


class JointTree:
    """A tree of J joints, parents before children; `parents[0]` is -1."""

    def __init__(self, parents: tuple[int, ...], dtype: torch.dtype) -> None:
        world = len(parents)
        above = [world, *parents[1:], world]
        self._above = torch.tensor(above)
        # What each frame is chained to, round by round, until all are relative to the world. A
        # round doubles the number of joints that a frame has behind it.
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
        self, bones: Bones, by_carrying: Tensor, by_pose_features: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Derivatives by pose (B, J, 3), trans (B, 3) and the joints' places at rest (B, J, 3).

        From those by `T_world_rest` and, (3, 3, B, J - 1), `pose_features` of all but the root.
        """
        turn, place = bones.T_world_joint[:, :3], bones.T_world_joint[:, 3, :, :-1]
        above = turn.index_select(3, self._above[:-1])
        torque = _moment(bones.T_world_rest, by_carrying)
        force, torque = (torch.stack([by_carrying[:, 3], torque]) @ self._subtree.T).unbind()
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
