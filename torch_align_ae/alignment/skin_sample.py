"""The vertices that the robust aligner fits, divided into patches that few joints move.

It computes posed vertices and their analytic Jacobian by the pose (Eq. 1-2). Unknowns are small
rotation vectors of the joints *in the world's axes*: everything below a joint then moves by a cross
product with its position relative to the joint, so the columns are sums over the joints below and
need no matrix product. Pose blend shapes add the displacement of the rest vertices by the rotation.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from bridge.paper import N_JOINTS
from torch_align_ae.body import SMPL
from torch_align_ae.body.rotations import cross_matrix
from torch_align_ae.body.smpl import subtree_matrix, world_frames

# Pose blend shapes that displace no vertex by more than this per radian of a joint are left out of
# the Jacobian, though not of the residual.
_NEGLIGIBLE_M = 1e-4


class Pose(NamedTuple):
    rotations: Tensor  # (B, 22, 3, 3) of each joint relative to its parent
    trans: Tensor  # (B, 3) metres


class Shaped(NamedTuple):
    """One subject's body in the rest pose."""

    sample: SkinSample
    vertices: Tensor  # (3, N) of the sample, metres, without pose blend shapes
    joints: Tensor  # (22, 3) metres

    def posed(self, pose: Pose) -> Posed:
        joints = self.joints.expand(len(pose.trans), -1, -1)
        turn, place = world_frames(pose.rotations, joints, self.sample.parents, pose.trans)
        return Posed(self, pose, turn, place, place - (turn @ joints[..., None])[..., 0])


class Posed(NamedTuple):
    """A body in B poses: its joints in the world."""

    shaped: Shaped
    pose: Pose
    turn: Tensor  # (B, 22, 3, 3) orientation
    place: Tensor  # (B, 22, 3) position, metres
    shift: Tensor  # (B, 22, 3) translation of the bone's transform from the rest pose, metres

    @property
    def features(self) -> Tensor:
        """(B, 189) entries of R - I of every joint but the root."""
        identity = torch.eye(3, dtype=self.turn.dtype)
        return (self.pose.rotations[:, 1:] - identity).flatten(1)

    def positions(self) -> Tensor:
        """(B, 3, N) vertices of the sample, metres."""
        patches = self.shaped.sample.patches
        return torch.cat([patch.moved_by_bones(self, patch.weights).sum(1) for patch in patches], 2)


class SampledPatch(NamedTuple):
    """n neighbouring vertices of the sample."""

    vertices: slice  # rows of the sample
    bones: Tensor  # (K,) bones that move it
    weights: Tensor  # (K, n) their skinning weights
    joints: Tensor  # (C,) that move it: those with pose blend shapes here, then bones and all above
    below: Tensor  # (C, K) ones where the bone is the joint or hangs below it
    below_weights: Tensor  # (C, n) sums of each vertex's skinning weights at and below the joint
    jacobian_posedirs: Tensor  # (P, 9, 3 n) pose blend shapes of the first P of `joints`, metres
    parents: Tensor  # (P,) the joints above these
    features: Tensor  # (Q,) entries of R - I that displace it at all
    posedirs: Tensor  # (Q, 3 n) displacement per unit of each, metres

    def linearise(self, posed: Posed, scale: Tensor) -> tuple[Tensor, Tensor]:
        """Posed vertices of the patch and their Jacobian, both times `scale` (n,), which is the
        square root of each vertex's weight.

        Positions (B, 3, n) are in metres. The Jacobian (B, C + 1, 3, 3, n) is by the turn of joint
        c about world axis i, radians, and, last, by the translation; then coordinates and vertices.
        """
        weights = self.weights * scale
        moved = self.moved_by_bones(posed, weights)
        arms = (self.below @ moved.flatten(2)).unflatten(2, (3, -1))
        arms -= (self.below_weights * scale)[:, None] * posed.place[:, self.joints, :, None]
        jacobian = arms.new_zeros(len(moved), len(self.joints) + 1, 3, 3, moved.shape[3])
        for axis in range(3):  # e_i x arm for each world axis i
            following, last = (axis + 1) % 3, (axis + 2) % 3
            torch.neg(arms[:, :, last], out=jacobian[:, :-1, axis, following])
            jacobian[:, :-1, axis, last] = arms[:, :, following]
            jacobian[:, -1, axis, axis] = scale
        if len(self.jacobian_posedirs):
            self._add_corrections(jacobian, posed, weights)
        return moved.sum(1), jacobian

    def moved_by_bones(self, posed: Posed, weights: Tensor) -> Tensor:
        """Contributions (B, K, 3, n) of the bones to the posed vertices, which are their sums."""
        corrective = posed.features.index_select(1, self.features) @ self.posedirs
        rest = corrective.unflatten(1, (3, -1))
        rest += posed.shaped.vertices[:, self.vertices]  # Eq. 2
        turn, shift = posed.turn[:, self.bones], posed.shift[:, self.bones]
        moved = (turn.flatten(1, 2) @ rest).unflatten(1, (-1, 3))
        return moved.add_(shift[..., None]).mul_(weights[:, None])

    def _add_corrections(self, jacobian: Tensor, posed: Posed, weights: Tensor) -> None:
        """Add the derivatives of pose blend shapes by the rotation of their joint."""
        count = len(self.jacobian_posedirs)
        joints = self.joints[:count]
        # In the parent's axes, world axis i is row i of the parent's orientation.
        spin = cross_matrix(posed.turn[:, self.parents]) @ posed.pose.rotations[:, joints, None]
        spin = spin.transpose(0, 1).flatten(1, 2).flatten(2)  # (P, B * 3, 9)
        rest_change = (spin @ self.jacobian_posedirs).unflatten(1, (-1, 3)).unflatten(3, (3, -1))
        rest_change = rest_change.transpose(0, 1)  # (B, P, 3 axes, 3 coordinates, n)
        turn = posed.turn[:, self.bones].permute(0, 2, 3, 1).flatten(1, 2)
        blended = (turn @ weights).unflatten(1, (3, 3))  # (B, 3, 3, n)
        change = blended[:, None, None, :, 0] * rest_change[:, :, :, None, 0]
        for axis in (1, 2):
            change.addcmul_(blended[:, None, None, :, axis], rest_change[:, :, :, None, axis])
        jacobian[:, :count] += change


class SkinSample:
    """About `size` vertices, N, spread over the skin in proportion to each bone's vertices.

    theta has no hands, so their skinning weights are added to the wrists'.
    """

    def __init__(self, smpl: SMPL, size: int) -> None:
        self.smpl = smpl
        self.parents = smpl.parents[:N_JOINTS]
        weights = smpl.moving_weights()
        self.subtree = subtree_matrix(self.parents).to(weights.dtype)
        groups = _limb_by_limb(weights, self.parents, size)
        self.vertices = torch.cat(groups)  # (N,) indices into the mesh, in the order of the patches
        self.weights = weights[:, self.vertices]  # (22, N) for skinning
        ends = torch.tensor([len(group) for group in groups]).cumsum(0).tolist()
        self.patches = [
            self._patch(slice(start, end), weights)
            for start, end in zip([0, *ends[:-1]], ends, strict=True)
        ]

    def __len__(self) -> int:
        return len(self.vertices)

    def select(self, meshes: Tensor) -> Tensor:
        """The sample (B, 3, N) of meshes (B, V, 3)."""
        return meshes[:, self.vertices].transpose(1, 2).contiguous()

    def shaped(self, betas: Tensor) -> Shaped:
        """The body of shape betas (10,)."""
        shape = torch.tensordot(betas, self.smpl.shapedirs[:, :, self.vertices], 1)
        joints = self.smpl.joints(betas[None])[0, :N_JOINTS]
        return Shaped(self, self.smpl.template[:, self.vertices] + shape, joints)

    def _patch(self, rows: slice, weights: Tensor) -> SampledPatch:
        chosen = self.vertices[rows]
        weights = weights[:, chosen]
        posedirs = self.smpl.posedirs[: 9 * (N_JOINTS - 1), :, chosen]
        by_joint = posedirs.unflatten(0, (N_JOINTS - 1, 9))
        bones = weights.any(1).nonzero()[:, 0]
        corrects = by_joint.norm(dim=(1, 2)).amax(1) > _NEGLIGIBLE_M
        correcting = corrects.nonzero()[:, 0] + 1
        above = self.subtree[:, bones].any(1)
        above[correcting] = False
        joints = torch.cat([correcting, above.nonzero()[:, 0]])
        features = posedirs.flatten(1).any(1).nonzero()[:, 0]
        return SampledPatch(
            vertices=rows,
            bones=bones,
            weights=weights[bones].contiguous(),
            joints=joints,
            below=self.subtree[joints][:, bones].contiguous(),
            below_weights=(self.subtree @ weights)[joints].contiguous(),
            jacobian_posedirs=by_joint[correcting - 1].flatten(2).contiguous(),
            parents=torch.tensor(self.parents)[correcting],
            features=features,
            posedirs=posedirs[features].flatten(1).contiguous(),
        )


def _limb_by_limb(weights: Tensor, parents: tuple[int, ...], size: int) -> list[Tensor]:
    """The sampled vertices of each limb: every n-th of those that each bone dominates."""
    dominant, count = weights.argmax(0), weights.shape[1]
    stride = max(1.0, count / size)
    # The first joint of each joint's limb; a limb starts where the tree branches.
    limbs: list[int] = []
    groups: dict[int, list[Tensor]] = {}
    for bone, parent in enumerate(parents):
        only_child = parents.count(parent) == 1 and parent >= 0
        limbs.append(limbs[parent] if only_child else bone)
        vertices = (dominant == bone).nonzero()[:, 0]
        if len(vertices):
            keep = torch.arange(0, len(vertices), stride, dtype=torch.float64).long()
            groups.setdefault(limbs[bone], []).append(vertices[keep])
    return [torch.cat(bones) for bones in groups.values()]
