"""The bones in the mesh distance: how they move, and what forces on their skin do to the joints.

A joint feels the force and the torque of everything that hangs on it, as in rigid-body mechanics.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from torch_align_ae.body.rotations import axial_vector, cross_matrix, left_jacobian


class Bones(NamedTuple):
    """Bones of a batch in motion, J joints each."""

    jacobian: Tensor
    """(B, J, 3, 3) turn of a joint in its parent's frame by a change of its axis-angle vector."""
    bend: Tensor
    """(B, J, 3, 3) R - I, R being the rotation of a joint in its parent's frame."""
    T_world_joint: Tensor
    """(B, J + 1, 4, 4); the last is the world's own frame."""
    T_world_rest: Tensor
    """(B, J, 3, 4) where a bone carries its skin."""


class JointGradient(NamedTuple):
    """Derivatives of a scalar by what moves the bones."""

    pose: Tensor
    """(B, J, 3) per radian."""
    trans: Tensor
    """(B, 3)."""
    joints: Tensor
    """(B, J, 3) by the joints' places at rest, while the skin keeps its shape."""


class JointTree:
    """A tree of J joints, parents before children; `parents[0]` is -1."""

    def __init__(self, parents: tuple[int, ...], dtype: torch.dtype) -> None:
        world = len(parents)
        above = [world, *parents[1:], world]
        self._above = torch.tensor(above)
        self._rounds = _rounds(above)
        self._subtree = _subtree_matrix(parents).to(dtype)
        self._at_rest = torch.eye(4, dtype=dtype).expand(1, len(above), 4, 4)

    def move(self, joints: Tensor, pose: Tensor, trans: Tensor) -> Bones:
        """Bones of pose (B, J, 3), radians, trans (B, 3) and joints at rest (B, J, 3), metres."""
        jacobian = left_jacobian(pose)
        bend = cross_matrix(pose) @ jacobian
        frames = self._at_rest.repeat(len(pose), 1, 1, 1)
        frames[:, :-1, :3, :3] += bend
        place = frames[:, :, :3, 3]
        place[:, 0] = trans
        place[:, :-1] += joints
        place[:, 1:-1] -= joints.index_select(1, self._above[1:-1])
        for above in self._rounds:
            frames = frames.index_select(1, above) @ frames
        turn, place = frames[:, :-1, :3, :3], frames[:, :-1, :3, 3:]
        shift = place - turn @ joints[..., None]
        return Bones(jacobian, bend, frames, torch.cat([turn, shift], -1))

    def gradient(self, bones: Bones, by_carrying: Tensor, by_bend: Tensor) -> JointGradient:
        """Derivatives by the joints, from those by what they do to the skin.

        Parameters
        ----------
        by_carrying : (B, J, 3, 4) derivatives by the entries of `T_world_rest`.
        by_bend : (B, J - 1, 3, 3) derivatives by `bend` of all but the root, the blend shapes'.
        """
        place = bones.T_world_joint[:, :-1, :3, 3]
        turn = bones.T_world_joint[..., :3, :3]
        above = turn.index_select(1, self._above[:-1])
        torque = axial_vector(by_carrying @ bones.T_world_rest.mT)
        force, torque = (self._subtree @ torch.cat([by_carrying[..., 3], torque], -1)).split(3, -1)
        torque = torque - torch.linalg.cross(place, force)
        spin = (above.mT @ torque[..., None])[..., 0]
        spin[:, 1:] += axial_vector(by_bend + by_bend @ bones.bend[:, 1:].mT)
        return JointGradient(
            pose=(bones.jacobian.mT @ spin[..., None])[..., 0],
            trans=force[:, 0],
            joints=((above - turn[:, :-1]).mT @ force[..., None])[..., 0],
        )


def _rounds(above: list[int]) -> list[Tensor]:
    """What each frame is chained to, round by round, until all are relative to the last, the world.

    A round doubles the number of joints that a frame has behind it.
    """
    rounds, world = [], len(above) - 1
    while set(above) != {world}:
        rounds.append(torch.tensor(above))
        above = [above[joint] for joint in above]
    return rounds


def _subtree_matrix(parents: tuple[int, ...]) -> Tensor:
    """(J, J) ones where the column's joint is the row's joint or hangs below it."""
    below = torch.eye(len(parents))
    for joint in range(len(parents) - 1, 0, -1):
        below[parents[joint]] += below[joint]
    return below
