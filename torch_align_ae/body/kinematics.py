"""Forward kinematics of a joint tree, one level of the tree at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True, eq=False)
class TreeLevels:
    """A joint tree cut into levels: all joints of a level are posed by one batched product."""

    parents: Tensor
    """(J,) parent of each joint; the root is its own."""
    sorted_joints: Tensor
    """(J,) joints by level, the root first."""
    place_of_joint: Tensor
    """(J,) inverse of `sorted_joints`."""
    sizes: tuple[int, ...]
    """Number of joints of each level."""
    parent_slots: tuple[Tensor, ...]
    """For each level below the root's, the places of its joints' parents in the level above."""


def tree_levels(parents: Sequence[int]) -> TreeLevels:
    """Cut a tree with `parents[0] == -1` and parents before children into levels."""
    levels, slots = [[0]], []
    while level := [joint for joint, parent in enumerate(parents) if parent in levels[-1]]:
        slots.append(torch.tensor([levels[-1].index(parents[joint]) for joint in level]))
        levels.append(level)
    sorted_joints = torch.tensor([joint for level in levels for joint in level])
    return TreeLevels(
        parents=torch.tensor(parents).clamp_min(0),
        sorted_joints=sorted_joints,
        place_of_joint=torch.argsort(sorted_joints),
        sizes=tuple(len(level) for level in levels),
        parent_slots=tuple(slots),
    )


def subtree_matrix(parents: Sequence[int]) -> Tensor:
    """(J, J) ones where the column's joint is the row's joint or hangs below it."""
    below = torch.eye(len(parents))
    for joint in range(len(parents) - 1, 0, -1):
        below[parents[joint]] += below[joint]
    return below


def world_frames(
    rotations: Tensor, joints: Tensor, levels: TreeLevels, trans: Tensor
) -> tuple[Tensor, Tensor]:
    """Orientation (B, J, 3, 3) and position (B, J, 3), metres, of each joint in the world.

    Parameters
    ----------
    rotations : (B, J, 3, 3) of each joint relative to its parent.
    joints : (B, J, 3) in the rest pose, metres.
    levels : the joint tree.
    trans : (B, 3) translation of the root, metres.
    """
    bones = joints - joints[:, levels.parents]
    local = torch.cat([rotations, bones[..., None]], -1)[:, levels.sorted_joints]
    root, *below = local.split(levels.sizes, 1)
    start = (joints[:, 0] + trans)[:, None, :, None]
    T_world_joint = [torch.cat([root[..., :3], start], -1)]
    for T_parent_joint, slots in zip(below, levels.parent_slots, strict=True):
        above = T_world_joint[-1][:, slots]
        turned = above[..., :3] @ T_parent_joint
        turned[..., 3].add_(above[..., 3])
        T_world_joint.append(turned)
    frames = torch.cat(T_world_joint, 1)[:, levels.place_of_joint]
    return frames[..., :3], frames[..., 3]


def bone_transforms(rotations: Tensor, joints: Tensor, levels: TreeLevels, trans: Tensor) -> Tensor:
    """(B, J, 3, 4) `T_world_rest` of each bone; arguments as in `world_frames`."""
    turn, place = world_frames(rotations, joints, levels, trans)
    shift = place - (turn @ joints[..., None])[..., 0]
    return torch.cat([turn, shift[..., None]], -1)
