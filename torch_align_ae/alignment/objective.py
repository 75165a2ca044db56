"""The mesh distance of Section 3.3 and its gradient, written out by hand.

An alignment evaluates it hundreds of thousands of times, so it works in place on contiguous
planes of vertices, and returns from vertices to joints before anything that is not a sum over
vertices: a joint feels a force and a torque, as in rigid-body mechanics. Automatic
differentiation of `SMPL.forward` gives the same numbers in five times the time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from bridge.exchange import N_JOINTS
from torch_align_ae.alignment.correctives import PoseCorrectives
from torch_align_ae.body import SMPL
from torch_align_ae.body.kinematics import tree_levels, world_frames
from torch_align_ae.body.rotations import axial_vector, axis_angle_to_matrix, left_jacobian

# A mesh that is met exactly has no direction of steepest descent; it then stays where it is.
_SMALLEST_DISTANCE_M = 1e-12


@dataclass(frozen=True)
class Shapes:
    """Bodies of a batch at rest, without pose blend shapes."""

    vertices: Tensor
    """(B, 3, V) metres, coordinates first."""
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
    rest_vertices: Tensor
    """(B, 3, V)."""
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
        self._weights = weights
        self._levels = tree_levels(parents)
        self._parents = list(parents[1:])
        self._subtree = _subtree_matrix(parents).to(weights.dtype)
        self._correctives = PoseCorrectives(smpl.posedirs[: 9 * (N_JOINTS - 1)])

    def shapes(self, betas: Tensor) -> Shapes:
        """Bodies of shape betas (B, 10)."""
        vertices, joints = self.smpl.rest(betas)
        return Shapes(vertices.transpose(1, 2).contiguous(), joints[:, :N_JOINTS].contiguous())

    def betas_gradient(self, gradient: Gradient) -> Tensor:
        """(B, 10) derivative of the distances by the shape."""
        by_vertices = gradient.rest_vertices.flatten(1) @ self.smpl.shapedirs.flatten(1).T
        by_joints = (
            gradient.joints.flatten(1) @ self.smpl.joint_shapedirs[:, :N_JOINTS].flatten(1).T
        )
        return by_vertices + by_joints

    def workspace(self, count: int) -> Tensor:
        """Memory (B, 4, 3, V) that `gradient` overwrites: new pages each step would cost more."""
        return self._weights.new_zeros(count, 4, 3, self.smpl.vertex_count)

    def gradient(
        self, shapes: Shapes, pose: Tensor, trans: Tensor, target: Tensor, planes: Tensor
    ) -> Gradient:
        """Distance of posed bodies to meshes, and its gradient.

        Parameters
        ----------
        shapes : B bodies.
        pose : (B, 22, 3) axis-angle, radians.
        trans : (B, 3) metres.
        target : (B, 3, V) meshes, metres, coordinates first.
        planes : `workspace(B)`.
        """
        frames = self._frames(shapes, pose, trans)
        rest = self._correctives.add_to(shapes.vertices, frames.rotations)
        self._blend(frames, out=planes)
        residual = _skin(planes, rest).sub_(target)
        distance = residual.flatten(1).norm(dim=1)
        pull = residual.div_(distance.clamp_min(_SMALLEST_DISTANCE_M)[:, None, None])
        rest_pull = _unskin(planes, pull)

        moment, force = self._gather(rest, pull, out=planes)
        corrective = self._correctives.gradient(rest_pull)
        force, spin, above = self._forces_at_joints(frames, moment, force, corrective)
        return Gradient(
            distance=distance,
            pose=(left_jacobian(pose).mT @ spin[..., None])[..., 0],
            trans=force[:, 0],
            rest_vertices=rest_pull,
            joints=((above - frames.turn).mT @ force[..., None])[..., 0],
        )

    def _frames(self, shapes: Shapes, pose: Tensor, trans: Tensor) -> _Frames:
        rotations = axis_angle_to_matrix(pose)
        turn, place = world_frames(rotations, shapes.joints, self._levels, trans)
        shift = place - (turn @ shapes.joints[..., None])[..., 0]
        return _Frames(rotations, turn, place, shift)

    def _forces_at_joints(
        self, frames: _Frames, moment: Tensor, force: Tensor, corrective: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Force on each joint's subtree (B, 22, 3), derivative by a turn in the parent's frame
        (B, 22, 3), and the parents' orientations (B, 22, 3, 3).
        """
        turn, place, shift = frames.turn, frames.place, frames.shift
        torque = axial_vector(moment @ turn.mT + force[..., None] * shift[..., None, :])
        force, torque = self._subtree @ force, self._subtree @ torque
        torque = torque - torch.linalg.cross(place, force)
        root = torch.eye(3, dtype=turn.dtype).expand(len(turn), 1, 3, 3)
        above = torch.cat([root, turn[:, self._parents]], 1)
        spin = (above.mT @ torque[..., None])[..., 0]
        spin[:, 1:] += axial_vector(corrective @ frames.rotations[:, 1:].mT)
        return force, spin, above

    def _blend(self, frames: _Frames, out: Tensor) -> None:
        """Blended transforms (B, 4, 3, V): three columns of the rotation, then the shift."""
        columns = torch.cat([frames.turn, frames.shift[..., None]], -1).permute(0, 3, 2, 1)
        torch.mm(columns.reshape(-1, N_JOINTS), self._weights, out=out.flatten(0, 2))

    def _gather(self, rest: Tensor, pull: Tensor, out: Tensor) -> tuple[Tensor, Tensor]:
        """Moments sum_i w_ij g_i p_i^T (B, 22, 3, 3) and forces sum_i w_ij g_i (B, 22, 3)."""
        torch.mul(rest[:, :, None], pull[:, None], out=out[:, :3])
        out[:, 3] = pull
        # Twice as fast as the transposed product, which has few columns.
        sums = (self._weights @ out.flatten(0, 2).T).unflatten(1, (-1, 4, 3))
        return sums[:, :, :3].permute(1, 0, 3, 2), sums[:, :, 3].transpose(0, 1)


def _skin(planes: Tensor, rest: Tensor) -> Tensor:
    """Posed vertices (B, 3, V) of rest vertices (B, 3, V)."""
    posed = torch.addcmul(planes[:, 3], planes[:, 0], rest[:, 0:1])
    return posed.addcmul_(planes[:, 1], rest[:, 1:2]).addcmul_(planes[:, 2], rest[:, 2:3])


def _unskin(planes: Tensor, pull: Tensor) -> Tensor:
    """Transposed rotation part of `_skin`: (B, 3, V)."""
    return (planes[:, :3] * pull[:, None]).sum(2)


def _subtree_matrix(parents: tuple[int, ...]) -> Tensor:
    """(J, J) ones where the column's joint is the row's joint or hangs below it."""
    below = torch.eye(len(parents))
    for joint in range(len(parents) - 1, 0, -1):
        below[parents[joint]] += below[joint]
    return below
