"""The mesh distance of Section 3.3 and its gradient, written out by hand.

An alignment evaluates it hundreds of thousands of times. So it is computed patch by patch, while a
patch is in the cache, and only sums over vertices are kept for the bones. Automatic differentiation
gives the same numbers, but in the one thread of a worker takes several times as long: three times
even patch by patch (docs/alignment.md), and five times for the bones alone.

*Skin.* With w_k the weights, T_k = [R_k t_k] the bones' transforms and x the rest vertex, the posed
vertex less the mesh's is r = sum_k w_k (R_k x + t_k) - s. Of half the squared distance, |r|^2 / 2,
the derivatives are r by t, r x^T by R (both blended, so weighted by w_k for bone k) and
(sum_k w_k R_k)^T r by x; from the latter follow those by the features of the blend shapes.

*Bones.* See `joint_tree`, also for the layout of its vectors and matrices.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from bridge.paper import N_JOINTS
from torch_align_ae.alignment.joint_tree import Bones, JointTree
from torch_align_ae.body import SMPL

_SMALLEST_DISTANCE_M = 1e-12
# Measured: smaller patches have too much overhead, larger ones do not fit into the cache.
_LARGEST_MERGED_PATCH = 800


class SkinPatch(NamedTuple):
    """N vertices that few bones move."""

    vertices: Tensor  # (N,) which they are
    bones: Tensor  # (K,) bones that move them
    weights: Tensor  # (K, N) their skinning weights
    features: Tensor  # (P,) entries of R - I, of all joints but the root, that correct them
    posedirs: Tensor  # (P, 3 N) displacement per unit of each, metres: all x, all y, all z
    posedirs_by_row: Tensor  # (3 N, P) transposed: sums over vertices are three times faster


def cut_into_patches(weights: Tensor, posedirs: Tensor, parents: Sequence[int]) -> list[SkinPatch]:
    """Divide all vertices into patches that one or a few bones move.

    This is exact: a bone or joint that is missing in a patch has weights (J, V) or blend shapes
    (9 (J - 1), 3, V) of exactly zero there.
    """
    main_bone = weights.argmax(0)
    sizes = torch.bincount(main_bone, minlength=len(weights)).tolist()
    # For each bone, the bone that represents its patch: children are merged into their parents.
    joined = list(range(len(sizes)))
    for bone in range(len(sizes) - 1, 0, -1):
        parent = parents[bone]
        if sizes[bone] + sizes[parent] <= _LARGEST_MERGED_PATCH:
            sizes[parent] += sizes[bone]
            joined[bone] = parent
    for bone in range(1, len(sizes)):
        joined[bone] = joined[joined[bone]]
    patch_of_vertex = torch.tensor(joined)[main_bone]
    patches = []
    for patch in patch_of_vertex.unique():
        vertices = (patch_of_vertex == patch).nonzero()[:, 0]
        patch_weights, directions = weights[:, vertices], posedirs[:, :, vertices].flatten(1)
        bones, features = patch_weights.any(1).nonzero()[:, 0], directions.any(1).nonzero()[:, 0]
        directions = directions[features]
        patches.append(
            SkinPatch(
                vertices,
                bones,
                patch_weights[bones],
                features,
                directions,
                directions.T.contiguous(),
            )
        )
    return patches


class _PatchWork:
    """A patch of N vertices and the memory to compute a batch of it.

    Views of the memory are made only once: in each step they would take as long as the arithmetic,
    and new memory longer. All patches share `planes` (B * 12 N or more numbers) and `rest`
    (B * 3 N); `target` (B, 3 N) is in metres.
    """

    def __init__(self, patch: SkinPatch, target: Tensor, planes: Tensor, rest: Tensor) -> None:
        self._patch = patch
        count, size = len(target), len(patch.vertices)
        self._target = target.view(count, 3, size)
        # The blended transform of each vertex, columns before rows; later its derivatives.
        self._planes = planes[: count * 12 * size].view(count * 12, size)
        columns = self._planes.view(count, 4, 3, size)
        self._turn, self._residual = columns[:, :3], columns[:, 3]
        self._residual_rows = self._residual[:, None]
        self._rest = rest[: count * 3 * size].view(count, 3 * size)
        self._rest_columns = self._rest.view(count, 3, 1, size)
        self._skinning = list(zip(self._turn.unbind(1), self._rest_columns.unbind(1), strict=True))
        residuals = self._residual[:, :, None].unbind(1)
        self._unskinning = list(zip(self._turn.unbind(2), residuals, strict=True))
        # Derivatives of half the squared distance by the arguments of `distance`.
        self.by_bones = target.new_zeros(len(patch.bones), count * 12)
        self.by_features = target.new_zeros(count, len(patch.features))
        self.by_shaped = torch.zeros_like(self._rest)
        self._by_shaped = self.by_shaped.view(count, 3, size)

    def distance(self, shaped: Tensor, transforms: Tensor, features: Tensor) -> Tensor:
        """Distances (B,) of the posed patch, metres; stores the derivatives.

        `shaped` (B, 3 N) is the patch in the rest pose without pose blend shapes, metres,
        `transforms` (B * 12, K) are those of the bones, columns before rows, and `features` (B, P)
        entries of R - I.
        """
        torch.mm(transforms, self._patch.weights, out=self._planes)
        torch.addmm(shaped, features, self._patch.posedirs, out=self._rest)
        self._residual.sub_(self._target)
        for column, coordinate in self._skinning:
            self._residual.addcmul_(column, coordinate)
        distance = torch.linalg.vector_norm(self._residual, dim=(1, 2))
        (row, residual), *others = self._unskinning
        torch.mul(row, residual, out=self._by_shaped)
        for row, residual in others:
            self._by_shaped.addcmul_(row, residual)
        torch.mul(self._rest_columns, self._residual_rows, out=self._turn)
        torch.mm(self._patch.weights, self._planes.T, out=self.by_bones)
        torch.mm(self.by_shaped, self._patch.posedirs_by_row, out=self.by_features)
        return distance


class Shapes(NamedTuple):
    """Bodies of a batch in the rest pose, without pose blend shapes."""

    objective: MeshDistance
    betas: Tensor  # (B, 10)
    vertices: Tensor  # (B, 3 V) metres, in the order of `MeshDistance.arrange`
    joints: Tensor  # (B, 22, 3) metres

    def rows(self, rows: slice | list[int]) -> Shapes:
        return Shapes(self.objective, self.betas[rows], self.vertices[rows], self.joints[rows])


class Gradient(NamedTuple):
    """The distance of each mesh, metres, and its derivatives."""

    distance: Tensor  # (B,) L2 norm over all coordinates of a mesh: not squared, as in the paper
    pose: Tensor  # (B, 22, 3) per radian
    trans: Tensor  # (B, 3)


class MeshDistance:
    """|| W(T + M_S(beta) + M_P(theta)) - S ||_2 for batches of bodies with 22 moving joints.

    theta has no hands, so their skinning weights are added to the wrists'.
    """

    def __init__(self, smpl: SMPL) -> None:
        self.smpl = smpl
        parents = smpl.parents[:N_JOINTS]
        weights = smpl.moving_weights()
        self.tree = JointTree(parents, weights.dtype)
        self.patches = cut_into_patches(weights, smpl.posedirs[: 9 * (N_JOINTS - 1)], parents)
        axes = torch.arange(3)[:, None]
        self._order = torch.cat([(3 * p.vertices + axes).flatten() for p in self.patches])
        self._place = torch.argsort(self._order)
        self._template = self.arrange(smpl.template.T[None])
        self.shapedirs = self.arrange(smpl.shapedirs.mT)
        self.joint_shapedirs = smpl.joint_shapedirs[:, :N_JOINTS].flatten(1)

    def arrange(self, vertices: Tensor) -> Tensor:
        """Meshes (B, V, 3) as (B, 3 V): patch by patch, and of each all x, all y, all z."""
        return vertices.flatten(1)[:, self._order]

    def restore(self, arranged: Tensor) -> Tensor:
        """The meshes (B, V, 3) that `arrange` was given."""
        return arranged[:, self._place].unflatten(1, (-1, 3))

    def shapes(self, betas: Tensor) -> Shapes:
        """Bodies of shape betas (B, 10)."""
        vertices = torch.addmm(self._template, betas, self.shapedirs)
        return Shapes(self, betas, vertices, self.smpl.joints(betas)[:, :N_JOINTS])

    def to(self, target: Tensor) -> DistanceTo:
        """The distance to meshes (B, 3 V) from `arrange`, metres."""
        return DistanceTo(self, target)


class DistanceTo:
    """`MeshDistance` of a batch of bodies to one mesh each, with memory for the computation."""

    def __init__(self, objective: MeshDistance, target: Tensor) -> None:
        self._objective, patches = objective, objective.patches
        self._bones = torch.cat([patch.bones for patch in patches])
        self._features = torch.cat([patch.features for patch in patches])
        # Sizes of the patches: coordinates of vertices, bones, features.
        self._sizes = [3 * len(patch.vertices) for patch in patches]
        self._bone_counts = [len(patch.bones) for patch in patches]
        self._feature_counts = [len(patch.features) for patch in patches]
        rest = target.new_zeros(len(target) * max(self._sizes))
        planes = target.new_zeros(4 * len(rest))
        self._work = [
            _PatchWork(patch, part, planes, rest)
            for patch, part in zip(patches, target.split(self._sizes, 1), strict=True)
        ]

    def gradient(self, shapes: Shapes, pose: Tensor, trans: Tensor) -> Gradient:
        """Distance and its gradient at pose (B, 22, 3), radians, and trans (B, 3), metres."""
        tree = self._objective.tree
        bones = tree.move(shapes.joints, pose, trans)
        distance, by_transforms, by_pose_features = self.of_skin(shapes, bones)
        # At a distance of 0 the gradient is 0.
        self._scale = 1 / distance.clamp_min(_SMALLEST_DISTANCE_M)[:, None]
        by_pose, by_trans, self._by_joints = tree.gradient(
            bones, by_transforms * self._scale, by_pose_features * self._scale
        )
        return Gradient(distance, by_pose, by_trans)

    def betas_gradient(self) -> Tensor:
        """Derivatives (B, 10) of the distances by the betas, where `gradient` was called last."""
        by_vertices = torch.cat([work.by_shaped for work in self._work], 1) * self._scale
        by_skin = by_vertices @ self._objective.shapedirs.T
        # Plus those by the joints in the rest pose.
        return by_skin + self._by_joints.flatten(1) @ self._objective.joint_shapedirs.T

    def of_skin(self, shapes: Shapes, bones: Bones) -> tuple[Tensor, Tensor, Tensor]:
        """Distances (B,), metres, and the derivatives of half their squares by the bones,
        (3, 4, B, 22), and by R - I of all joints but the root, (3, 3, B, 21)."""
        count = len(shapes.vertices)
        transforms = bones.T_world_rest.permute(2, 1, 0, 3).flatten(0, 2)
        features = bones.pose_features[..., 1:].permute(2, 3, 0, 1).flatten(1)
        parts = zip(
            self._work,
            shapes.vertices.split(self._sizes, 1),
            transforms.index_select(1, self._bones).split(self._bone_counts, 1),
            features.index_select(1, self._features).split(self._feature_counts, 1),
            strict=True,
        )
        distances = torch.stack([work.distance(*part) for work, *part in parts])
        by_bones = torch.cat([work.by_bones for work in self._work])
        by_features = torch.cat([work.by_features for work in self._work], 1)
        by_transforms = by_bones.new_zeros(N_JOINTS, count * 12)
        by_transforms.index_add_(0, self._bones, by_bones)
        by_pose_features = by_features.new_zeros(count, 9 * (N_JOINTS - 1))
        by_pose_features.index_add_(1, self._features, by_features)
        return (
            torch.linalg.vector_norm(distances, dim=0),
            by_transforms.view(N_JOINTS, count, 4, 3).permute(3, 2, 1, 0),
            by_pose_features.view(count, N_JOINTS - 1, 3, 3).permute(2, 3, 0, 1),
        )
