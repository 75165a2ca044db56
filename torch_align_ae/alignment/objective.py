"""The mesh distance of Section 3.3 and its gradient, written out by hand.

An alignment evaluates it hundreds of thousands of times, so it goes through the skin patch by
patch, each while it is in the cache, and keeps only sums over vertices: a joint feels a force and
a torque, as in rigid-body mechanics. Automatic differentiation of `SMPL.forward` gives the same
numbers in four times the time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from bridge.exchange import N_JOINTS
from torch_align_ae.alignment.patches import cut_into_patches
from torch_align_ae.body import SMPL
from torch_align_ae.body.kinematics import tree_levels, world_frames
from torch_align_ae.body.rotations import axial_vector, axis_angle_to_matrix, left_jacobian

# A mesh that is met exactly has no direction of steepest descent; it then stays where it is.
_SMALLEST_DISTANCE_M = 1e-12


@dataclass(frozen=True)
class Shapes:
    """Bodies of a batch at rest, without pose blend shapes."""

    vertices: Tensor
    """(B, 3, V) metres, in the order of the patches."""
    joints: Tensor
    """(B, 22, 3) metres."""

    def rows(self, rows: slice | list[int]) -> Shapes:
        """Some bodies of the batch."""
        return Shapes(self.vertices[rows], self.joints[rows])


@dataclass(frozen=True)
class Gradient:
    """The distance of each mesh, metres, and its derivatives."""

    distance: Tensor
    """(B,) L2 norm over all coordinates of a mesh: not squared, as in the paper."""
    pose: Tensor
    """(B, 22, 3) per radian."""
    trans: Tensor
    """(B, 3)."""
    rest_vertices: tuple[Tensor, ...]
    """(B, 3, N) of each patch, times the distance: scaled only where it is needed."""
    joints: Tensor
    """(B, 22, 3), through the bones only: not through vertices that follow the same betas."""


class _Frames(NamedTuple):
    """Joints in motion."""

    rotations: Tensor
    """(B, 22, 3, 3) relative to the parent."""
    turn: Tensor
    """(B, 22, 3, 3) orientation in the world."""
    place: Tensor
    """(B, 22, 3) position in the world, metres."""
    shift: Tensor
    """(B, 22, 3) where the bone's transform takes the origin of the rest pose, metres."""


class MeshDistance:
    """|| W(T + M_S(beta) + M_P(theta)) - S ||_2 for batches of bodies with 22 moving joints.

    Hands never move in theta, so their vertices are handed to the wrists.
    """

    def __init__(self, smpl: SMPL) -> None:
        self.smpl = smpl
        parents = smpl.parents[:N_JOINTS]
        weights = smpl.weights[:N_JOINTS].clone()
        for hand in range(N_JOINTS, len(smpl.parents)):
            weights[smpl.parents[hand]] += smpl.weights[hand]
        posedirs = smpl.posedirs[: 9 * (N_JOINTS - 1)]
        self._levels = tree_levels(parents)
        self._parents = torch.tensor(parents[1:])
        self._subtree = _subtree_matrix(parents).to(weights.dtype)
        self._order, self._patches = cut_into_patches(weights, posedirs, parents)
        self._template = smpl.template[:, self._order]
        self._shapedirs = smpl.shapedirs[:, :, self._order].flatten(1)

    def arrange(self, vertices: Tensor) -> Tensor:
        """Meshes (B, V, 3) as (B, 3, V) in the order of the patches."""
        return vertices[:, self._order].transpose(1, 2).contiguous()

    def shapes(self, betas: Tensor) -> Shapes:
        """Bodies of shape betas (B, 10)."""
        vertices = self._template + (betas @ self._shapedirs).unflatten(1, (3, -1))
        return Shapes(vertices, self.smpl.joints(betas)[:, :N_JOINTS])

    def betas_gradient(self, gradient: Gradient) -> Tensor:
        """(B, 10) derivative of the distances by the shape."""
        pull = torch.cat(gradient.rest_vertices, 2).flatten(1)
        scale = gradient.distance.clamp_min(_SMALLEST_DISTANCE_M)[:, None]
        by_vertices = pull @ self._shapedirs.T / scale
        joint_shapedirs = self.smpl.joint_shapedirs[:, :N_JOINTS].flatten(1)
        return by_vertices + gradient.joints.flatten(1) @ joint_shapedirs.T

    def workspace(self, count: int) -> Tensor:
        """Memory that `gradient` overwrites: fresh pages at each step would cost more."""
        largest = max(patch.weights.shape[1] for patch in self._patches)
        return self._template.new_zeros(count * 12 * largest)

    def gradient(
        self, shapes: Shapes, pose: Tensor, trans: Tensor, target: Tensor, workspace: Tensor
    ) -> Gradient:
        """Distance of posed bodies to meshes, and its gradient.

        Parameters
        ----------
        shapes : B bodies.
        pose : (B, 22, 3) axis-angle, radians.
        trans : (B, 3) metres.
        target : (B, 3, V) meshes, metres, from `arrange`.
        workspace : `self.workspace(B)`.
        """
        frames = self._frames(shapes, pose, trans)
        columns = torch.cat([frames.turn, frames.shift[..., None]], -1).permute(1, 0, 3, 2)
        features = _features(frames.rotations)
        by_bones = columns.new_zeros(N_JOINTS, len(pose) * 12)
        by_features, rest_pulls = torch.zeros_like(features), []
        squared = pose.new_zeros(len(pose))
        for patch in self._patches:
            planes = patch.blend(columns, workspace)
            rest = patch.rest(shapes.vertices, features)
            residual = _skin(planes, rest).sub_(target[:, :, patch.vertices])
            squared += residual.square().sum((1, 2))
            rest_pulls.append(_unskin(planes, residual))
            torch.mul(rest[:, :, None], residual[:, None], out=planes[:, :3])
            planes[:, 3] = residual
            patch.add_by_bones(planes, by_bones)
            patch.add_by_features(rest_pulls[-1], by_features)
        return self._at_joints(pose, frames, squared.sqrt(), by_bones, by_features, rest_pulls)

    def _frames(self, shapes: Shapes, pose: Tensor, trans: Tensor) -> _Frames:
        rotations = axis_angle_to_matrix(pose)
        turn, place = world_frames(rotations, shapes.joints, self._levels, trans)
        shift = place - (turn @ shapes.joints[..., None])[..., 0]
        return _Frames(rotations, turn, place, shift)

    def _at_joints(
        self,
        pose: Tensor,
        frames: _Frames,
        distance: Tensor,
        by_bones: Tensor,
        by_features: Tensor,
        rest_pulls: list[Tensor],
    ) -> Gradient:
        """From sums over vertices, of residuals that are not yet divided by their norm."""
        scale = 1 / distance.clamp_min(_SMALLEST_DISTANCE_M)[:, None, None]
        sums = by_bones.view(N_JOINTS, len(pose), 4, 3).transpose(0, 1)
        force, spin, above = self._forces(frames, sums, by_features.unflatten(1, (-1, 3, 3)))
        force, spin = scale * force, scale * spin
        return Gradient(
            distance=distance,
            pose=(left_jacobian(pose).mT @ spin[..., None])[..., 0],
            trans=force[:, 0],
            rest_vertices=tuple(rest_pulls),
            joints=((above - frames.turn).mT @ force[..., None])[..., 0],
        )

    def _forces(
        self, frames: _Frames, sums: Tensor, corrective: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Force on each joint's subtree (B, 22, 3), derivative by a turn in the parent's frame
        (B, 22, 3), and the parents' orientations (B, 22, 3, 3).
        """
        turn, place, shift = frames.turn, frames.place, frames.shift
        moment, force = sums[:, :, :3].mT, sums[:, :, 3]
        torque = axial_vector(moment @ turn.mT + force[..., None] * shift[..., None, :])
        force, torque = self._subtree @ force, self._subtree @ torque
        torque = torque - torch.linalg.cross(place, force)
        root = torch.eye(3, dtype=turn.dtype).expand(len(turn), 1, 3, 3)
        above = torch.cat([root, turn[:, self._parents]], 1)
        spin = (above.mT @ torque[..., None])[..., 0]
        spin[:, 1:] += axial_vector(corrective @ frames.rotations[:, 1:].mT)
        return force, spin, above


def _features(rotations: Tensor) -> Tensor:
    """(B, 189) entries of R - I of every joint but the root."""
    return (rotations[:, 1:] - torch.eye(3, dtype=rotations.dtype)).flatten(1)


def _skin(planes: Tensor, rest: Tensor) -> Tensor:
    """Posed vertices (B, 3, V) of rest vertices (B, 3, V)."""
    posed = torch.addcmul(planes[:, 3], planes[:, 0], rest[:, 0:1])
    return posed.addcmul_(planes[:, 1], rest[:, 1:2]).addcmul_(planes[:, 2], rest[:, 2:3])


def _unskin(planes: Tensor, pull: Tensor) -> Tensor:
    """Transposed rotation part of `_skin`: (B, 3, N)."""
    turns = planes[:, :3]
    rest_pull = turns[:, :, 0] * pull[:, 0:1]
    return rest_pull.addcmul_(turns[:, :, 1], pull[:, 1:2]).addcmul_(turns[:, :, 2], pull[:, 2:3])


def _subtree_matrix(parents: tuple[int, ...]) -> Tensor:
    """(J, J) ones where the column's joint is the row's joint or hangs below it."""
    below = torch.eye(len(parents))
    for joint in range(len(parents) - 1, 0, -1):
        below[parents[joint]] += below[joint]
    return below
