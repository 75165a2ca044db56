"""The mesh distance of Section 3.3 and its gradient, written out by hand.

An alignment evaluates it hundreds of thousands of times, so it goes through the skin patch by
patch, each while it is in the cache, and keeps only sums over vertices for the bones. Automatic
differentiation gives the same numbers; on the one thread of a worker it takes several times as
long, and about three times even patch by patch (`benchmarks.alignment.gradients`).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from bridge.paper import N_JOINTS
from torch_align_ae.alignment.paper.bones import Bones, JointTree
from torch_align_ae.alignment.paper.patches import PatchWork, cut_into_patches
from torch_align_ae.body import SMPL

# A mesh that is met exactly has no direction of steepest descent; it then stays where it is.
_SMALLEST_DISTANCE_M = 1e-12


@dataclass(frozen=True)
class Shapes:
    """Bodies of a batch at rest, without pose blend shapes."""

    vertices: Tensor
    """(B, 3 V) metres, in the order of `MeshDistance.arrange`."""
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
    joints: Tensor
    """(B, 22, 3) by the joints at rest, while the skin keeps its shape."""


class MeshDistance:
    """|| W(T + M_S(beta) + M_P(theta)) - S ||_2 for batches of bodies with 22 moving joints.

    Hands never move in theta, so their vertices are handed to the wrists.
    """

    def __init__(self, smpl: SMPL) -> None:
        self.smpl = smpl
        parents = smpl.parents[:N_JOINTS]
        weights = smpl.moving_weights()
        posedirs = smpl.posedirs[: 9 * (N_JOINTS - 1)]
        self.tree = JointTree(parents, weights.dtype)
        self.patches = cut_into_patches(weights, posedirs, parents)
        axes = torch.arange(3)[:, None]
        self._order = torch.cat([(3 * p.vertices + axes).flatten() for p in self.patches])
        self._place = torch.argsort(self._order)
        self._template = self.arrange(smpl.template.T[None])
        self._shapedirs = self.arrange(smpl.shapedirs.mT)
        self._joint_shapedirs = smpl.joint_shapedirs[:, :N_JOINTS].flatten(1)

    def arrange(self, vertices: Tensor) -> Tensor:
        """Meshes (B, V, 3) as (B, 3 V): patch by patch, and of each all x, all y, all z."""
        return vertices.flatten(1)[:, self._order]

    def restore(self, arranged: Tensor) -> Tensor:
        """The meshes (B, V, 3) that `arrange` was given."""
        return arranged[:, self._place].unflatten(1, (-1, 3))

    def shapes(self, betas: Tensor) -> Shapes:
        """Bodies of shape betas (B, 10)."""
        vertices = torch.addmm(self._template, betas, self._shapedirs)
        return Shapes(vertices, self.smpl.joints(betas)[:, :N_JOINTS])

    def by_betas(self, by_vertices: Tensor, by_joints: Tensor) -> Tensor:
        """(B, 10) derivatives by betas from those by `Shapes`' vertices and joints."""
        return by_vertices @ self._shapedirs.T + by_joints.flatten(1) @ self._joint_shapedirs.T

    def to(self, target: Tensor) -> DistanceTo:
        """The distance to meshes (B, 3 V) from `arrange`, metres."""
        return DistanceTo(self, target)


class DistanceTo:
    """`MeshDistance` of a batch of bodies to a mesh each, with the memory that it works in."""

    def __init__(self, objective: MeshDistance, target: Tensor) -> None:
        self._objective, patches = objective, objective.patches
        self._bones = torch.cat([patch.bones for patch in patches])
        self._features = torch.cat([patch.features for patch in patches])
        # Split like the patches: vertices' coordinates, bones, features.
        self._sizes = [3 * len(patch.vertices) for patch in patches]
        self._bone_counts = [len(patch.bones) for patch in patches]
        self._feature_counts = [len(patch.features) for patch in patches]
        rest = target.new_zeros(len(target) * max(self._sizes))
        planes = target.new_zeros(4 * len(rest))
        self._work = [
            PatchWork(patch, part, planes, rest)
            for patch, part in zip(patches, target.split(self._sizes, 1), strict=True)
        ]

    def gradient(self, shapes: Shapes, pose: Tensor, trans: Tensor) -> Gradient:
        """Distance and its gradient at pose (B, 22, 3), radians, and trans (B, 3), metres."""
        tree = self._objective.tree
        bones = tree.move(shapes.joints, pose, trans)
        distance = self._skin_and_pull(shapes, bones)
        scale = _inverse(distance)[:, None]
        by_carrying, by_pose_features = self._sums(len(pose))
        joints = tree.gradient(bones, by_carrying * scale, by_pose_features * scale)
        return Gradient(distance, *joints)

    def betas_gradient(self, gradient: Gradient) -> Tensor:
        """(B, 10) derivative of the distances by the shape, `gradient` being the latest."""
        by_vertices = torch.cat([work.by_shaped for work in self._work], 1)
        by_vertices *= _inverse(gradient.distance)[:, None]
        return self._objective.by_betas(by_vertices, gradient.joints)

    def _skin_and_pull(self, shapes: Shapes, bones: Bones) -> Tensor:
        """Distances (B,), metres; the derivatives of half their squares are left in the work."""
        carrying = bones.T_world_rest.permute(2, 1, 0, 3).flatten(0, 2)
        features = bones.pose_features[..., 1:].permute(2, 3, 0, 1).flatten(1)
        distances = []
        for work, *parts in zip(
            self._work,
            shapes.vertices.split(self._sizes, 1),
            carrying.index_select(1, self._bones).split(self._bone_counts, 1),
            features.index_select(1, self._features).split(self._feature_counts, 1),
            strict=True,
        ):
            distances.append(work.skin(*parts))
            work.pull()
        return torch.linalg.vector_norm(torch.stack(distances), dim=0)

    def _sums(self, count: int) -> tuple[Tensor, Tensor]:
        """The patches' derivatives by bones (3, 4, B, 22) and by R - I (3, 3, B, 21), summed."""
        by_bones = torch.cat([work.by_bones for work in self._work])
        by_features = torch.cat([work.by_features for work in self._work], 1)
        by_carrying = by_bones.new_zeros(N_JOINTS, count * 12)
        by_carrying.index_add_(0, self._bones, by_bones)
        by_pose_features = by_features.new_zeros(count, 9 * (N_JOINTS - 1))
        by_pose_features.index_add_(1, self._features, by_features)
        return (
            by_carrying.view(N_JOINTS, count, 4, 3).permute(3, 2, 1, 0),
            by_pose_features.view(count, N_JOINTS - 1, 3, 3).permute(2, 3, 0, 1),
        )


def _inverse(distance: Tensor) -> Tensor:
    return 1 / distance.clamp_min(_SMALLEST_DISTANCE_M)
