"""Forward kinematics of a joint tree, one level of the tree at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class TreeLevels:
    """A joint tree cut into levels: all joints of a level are posed by one batched product."""

    joints: tuple[tuple[int, ...], ...]
    """Joints of each level, the root's level first."""
    parent_slots: tuple[tuple[int, ...], ...]
    """For each joint of a level, the place of its parent within the level above."""
    parents: tuple[int, ...]
    """Parent of each joint; the root's is -1."""
    order: tuple[int, ...]
    """For each joint, its place in the levels laid end to end."""


def tree_levels(parents: Sequence[int]) -> TreeLevels:
    """Cut a tree with `parents[0] == -1` and parents before children into levels."""
    joints: list[tuple[int, ...]] = [(0,)]
    parent_slots: list[tuple[int, ...]] = [()]
    while level := tuple(j for j, parent in enumerate(parents) if parent in joints[-1]):
        parent_slots.append(tuple(joints[-1].index(parents[j]) for j in level))
        joints.append(level)
    laid_out = [joint for level in joints for joint in level]
    order = tuple(laid_out.index(joint) for joint in range(len(parents)))
    return TreeLevels(tuple(joints), tuple(parent_slots), tuple(parents), order)


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
    turn, place = [rotations[:, :1]], [joints[:, :1] + trans[:, None]]
    for level, slots in zip(levels.joints[1:], levels.parent_slots[1:], strict=True):
        parents = [levels.parents[joint] for joint in level]
        above, origin = turn[-1][:, slots], place[-1][:, slots]
        bone = joints[:, level] - joints[:, parents]
        turn.append(above @ rotations[:, level])
        place.append((above @ bone[..., None])[..., 0] + origin)
    return torch.cat(turn, 1)[:, levels.order], torch.cat(place, 1)[:, levels.order]


def bone_transforms(rotations: Tensor, joints: Tensor, levels: TreeLevels, trans: Tensor) -> Tensor:
    """(B, J, 3, 4) `T_world_rest` of each bone; arguments as in `world_frames`."""
    turn, place = world_frames(rotations, joints, levels, trans)
    shift = place - (turn @ joints[..., None])[..., 0]
    return torch.cat([turn, shift[..., None]], -1)
