"""SMPL in PyTorch: posing (Eq. 1-2), differentiable in every argument, and unposing (Eq. 5).

Inside, coordinates come before vertices, (B, 3, V): products of skinning then run over contiguous
vertices, three times faster than many 3 x 3 products.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bridge.body import BodyModelData
from bridge.errors import DsnetError
from bridge.paper import N_JOINTS
from torch_align_ae.body.rotations import axis_angle_to_matrix

# A half-and-half blend of two rotations phi apart has determinant cos^2(phi / 2): below this
# one (phi above 176 degrees) the inverse would blow up a millimetre to three centimetres.
_SINGULAR_BELOW = 1e-3


def register_constants(
    module: nn.Module, arrays: Mapping[str, NDArray], dtype: torch.dtype
) -> None:
    """Make arrays buffers of a module, which move with it and are not saved."""
    for name, array in arrays.items():
        tensor = torch.from_numpy(np.ascontiguousarray(array)).to(dtype)
        module.register_buffer(name, tensor, persistent=False)


def subtree_matrix(parents: Sequence[int]) -> Tensor:
    """(J, J) ones where the column's joint is the row's joint or hangs below it."""
    below = torch.eye(len(parents))
    for joint in range(len(parents) - 1, 0, -1):
        below[parents[joint]] += below[joint]
    return below


def world_frames(
    rotations: Tensor, joints: Tensor, parents: Sequence[int], trans: Tensor
) -> tuple[Tensor, Tensor]:
    """Orientation (B, J, 3, 3) and position (B, J, 3), metres, of each joint in the world.

    `rotations` (B, J, 3, 3) are relative to the parents, which come before children; `joints`
    (B, J, 3) are in the rest pose, in metres as `trans` (B, 3), the translation of the root.
    """
    bones = joints.clone()
    bones[:, 1:] -= joints[:, list(parents[1:])]
    bones[:, 0] += trans
    T_parent_joint = torch.cat([rotations, bones[..., None]], -1)
    T_world_joint = [T_parent_joint[:, 0]]
    for joint, parent in enumerate(parents[1:], start=1):
        above = T_world_joint[parent]
        turned = above[..., :3] @ T_parent_joint[:, joint]
        turned[..., 3].add_(above[..., 3])
        T_world_joint.append(turned)
    frames = torch.stack(T_world_joint, 1)
    return frames[..., :3], frames[..., 3]


def bone_transforms(
    rotations: Tensor, joints: Tensor, parents: Sequence[int], trans: Tensor
) -> Tensor:
    """(B, J, 3, 4) `T_world_rest` of each bone; arguments as in `world_frames`."""
    turn, place = world_frames(rotations, joints, parents, trans)
    shift = place - (turn @ joints[..., None])[..., 0]
    return torch.cat([turn, shift[..., None]], -1)


class SMPL(nn.Module):
    """A body model with constant parameters: V vertices, J joints, S shapes; 6890, 24, 10 for SMPL.

    Pass `dtype` float64 here; `.double()` later would only widen values that were already rounded.
    """

    template: Tensor
    shapedirs: Tensor
    posedirs: Tensor
    weights: Tensor
    joint_template: Tensor
    joint_shapedirs: Tensor

    def __init__(self, data: BodyModelData, dtype: torch.dtype = torch.float32) -> None:
        super().__init__()
        self.data = data
        self.parents: tuple[int, ...] = tuple(data.parents.tolist())
        buffers = {
            "template": data.v_template.T,  # (3, V)
            "shapedirs": data.shapedirs.transpose(2, 1, 0),  # (S, 3, V)
            "posedirs": data.posedirs.transpose(2, 1, 0),  # (9 (J - 1), 3, V)
            "weights": data.weights.T,  # (J, V)
            "joint_template": data.joints,  # (J, 3)
            "joint_shapedirs": data.joint_shapes.transpose(2, 0, 1),  # (S, J, 3)
        }
        register_constants(self, buffers, dtype)

    @property
    def vertex_count(self) -> int:
        return self.template.shape[1]

    def moving_weights(self) -> Tensor:
        """Skinning weights (22, V) of the joints of theta; those of hands are added to the wrists',
        those of a face to the head's."""
        weights = self.weights.clone()
        for hand in range(len(self.parents) - 1, N_JOINTS - 1, -1):  # fingers end first
            weights[self.parents[hand]] += weights[hand]
        return weights[:N_JOINTS]

    def forward(
        self, betas: Tensor, pose: Tensor, trans: Tensor, offsets: Tensor | None = None
    ) -> Tensor:
        """Posed vertices (B, V, 3), metres, Eq. 1-2.

        Parameters
        ----------
        betas : (B, k) shape, the first of the body's or all.
        pose : (B, J, 3) or (B, 22, 3) axis-angle, radians; hands and a face stay at rest then.
        trans : (B, 3) translation, metres.
        offsets : (B, V, 3) displacement added in the rest pose, metres, or None.
        """
        rotations = self.rotations(pose)
        rest = self.planar_rest(betas, rotations)
        if offsets is not None:
            _check_shape("offsets", offsets, (len(betas), self.vertex_count, 3))
            rest = rest + offsets.transpose(1, 2)
        blended = self.blended_transforms(betas, rotations, trans)
        posed = (blended[:, :, :3] * rest[:, None]).sum(2) + blended[:, :, 3]
        return posed.transpose(1, 2).contiguous()

    def rest_vertices(self, betas: Tensor, pose: Tensor) -> Tensor:
        """(B, V, 3) shaped body with pose blend shapes, before skinning (Eq. 2), metres."""
        return self.planar_rest(betas, self.rotations(pose)).transpose(1, 2)

    def joints(self, betas: Tensor) -> Tensor:
        """(B, J, 3) joints of the shaped body in the rest pose, metres."""
        count = self._shape_count(betas)
        return self.joint_template + torch.tensordot(betas, self.joint_shapedirs[:count], dims=1)

    def rotations(self, pose: Tensor) -> Tensor:
        """(B, J, 3, 3) rotation of each joint from (B, J, 3) or (B, 22, 3) axis-angle."""
        if pose.ndim != 3 or pose.shape[1:] not in ((N_JOINTS, 3), (len(self.parents), 3)):
            raise DsnetError(
                f"pose of shape {tuple(pose.shape)}",
                f"(B, {N_JOINTS}, 3) or (B, {len(self.parents)}, 3)",
                "Pass axis-angle vectors, not the flat theta of 69 numbers.",
            )
        missing = len(self.parents) - pose.shape[1]
        return axis_angle_to_matrix(nn.functional.pad(pose, (0, 0, 0, missing)))

    def planar_rest(self, betas: Tensor, rotations: Tensor) -> Tensor:
        """Eq. 2 as (B, 3, V)."""
        identity = torch.eye(3, dtype=rotations.dtype, device=rotations.device)
        features = (rotations[:, 1:] - identity).flatten(1)
        corrective = features @ self.posedirs.flatten(1)
        shape = betas @ self.shapedirs[: self._shape_count(betas)].flatten(1)
        return self.template + shape.unflatten(1, (3, -1)) + corrective.unflatten(1, (3, -1))

    def _shape_count(self, betas: Tensor) -> int:
        count = min(betas.shape[-1], len(self.shapedirs))
        _check_shape("betas", betas, (len(betas), count))
        return count

    def blended_transforms(self, betas: Tensor, rotations: Tensor, trans: Tensor) -> Tensor:
        """Each vertex's weighted mean of the bones' transforms, (B, 3, 4, V), rest to world."""
        _check_shape("trans", trans, (len(betas), 3))
        bones = bone_transforms(rotations, self.joints(betas), self.parents, trans)
        planar = bones.permute(0, 2, 3, 1).reshape(-1, len(self.parents))
        return (planar @ self.weights).unflatten(0, (-1, 3, 4))


def unpose(smpl: SMPL, vertices: Tensor, betas: Tensor, pose: Tensor, trans: Tensor) -> Tensor:
    """Rest-pose vertices (B, V, 3), metres, of a posed mesh (B, V, 3): Eq. 5's W^-1.

    `betas`, `pose` and `trans` are as in `SMPL.forward`; the pose blend shapes stay in the result.
    Where skinning has collapsed a vertex (bones turned half round against each other), the
    collapsed directions cannot be seen in the posed mesh; there the result keeps SMPL's own
    rest-pose vertex, so its offset is zero in these directions.
    """
    return _unposed(smpl, vertices, betas, pose, trans)[0].transpose(1, 2).contiguous()


def rest_pose_offsets(
    smpl: SMPL, vertices: Tensor, betas: Tensor, pose: Tensor, trans: Tensor
) -> tuple[Tensor, Tensor]:
    """Eq. 5: Delta = W^-1(S) - (T + M_S(beta) + M_P(theta)), and how far SMPL is from the mesh.

    Arguments as in `unpose`. Offsets (B, V, 3) in the rest pose, metres, and (B, V) distances of
    the posed body's vertices from the mesh's, metres.
    """
    unposed, rest, blended, centred = _unposed(smpl, vertices, betas, pose, trans)
    posed = (blended[:, :, :3] * rest[:, None]).sum(2)
    return (unposed - rest).transpose(1, 2).contiguous(), lengths(posed - centred)[:, 0]


def lengths(vectors: Tensor) -> Tensor:
    """Lengths (B, 1, N) of vectors (B, 3, N), many times faster than PyTorch's `norm` over an axis
    that is not the last."""
    return vectors.square().sum(1, keepdim=True).sqrt()


def _unposed(
    smpl: SMPL, vertices: Tensor, betas: Tensor, pose: Tensor, trans: Tensor
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Unposed mesh and SMPL's rest-pose vertices (B, 3, V), the blended transforms (B, 3, 4, V),
    and the mesh minus their translations (B, 3, V)."""
    _check_shape("vertices", vertices, (len(betas), smpl.vertex_count, 3))
    rotations = smpl.rotations(pose)
    rest = smpl.planar_rest(betas, rotations)
    blended = smpl.blended_transforms(betas, rotations, trans)
    centred = vertices.transpose(1, 2) - blended[:, :, 3]
    # Cramer's rule at every vertex.
    a, b, c = blended[:, :, 0], blended[:, :, 1], blended[:, :, 2]
    b_c = torch.linalg.cross(b, c, dim=1)
    determinant = (a * b_c).sum(1)
    singular = determinant.abs() < _SINGULAR_BELOW
    divisor = torch.where(singular, torch.ones_like(determinant), determinant)
    numerators = [
        (centred * b_c).sum(1),
        (centred * torch.linalg.cross(c, a, dim=1)).sum(1),
        (centred * torch.linalg.cross(a, b, dim=1)).sum(1),
    ]
    unposed = torch.stack(numerators, 1) / divisor[:, None]
    if singular.any():
        unposed = _keep_collapsed(unposed, singular, blended, centred, rest)
    return unposed, rest, blended, centred


def _keep_collapsed(
    result: Tensor, singular: Tensor, blended: Tensor, centred: Tensor, rest: Tensor
) -> Tensor:
    """Replace singular vertices by SMPL's rest vertices, with the least change to explain them."""
    body, vertex = singular.nonzero(as_tuple=True)
    matrix = blended[body, :, :3, vertex]
    start = rest[body, :, vertex]
    residual = centred[body, :, vertex] - (matrix @ start[..., None])[..., 0]
    inverse = torch.linalg.pinv(matrix, rtol=_SINGULAR_BELOW**0.5)
    corrected = start + (inverse @ residual[..., None])[..., 0]
    return result.transpose(1, 2).index_put((body, vertex), corrected).transpose(1, 2)


def _check_shape(name: str, tensor: Tensor, shape: tuple[int, ...]) -> None:
    if tuple(tensor.shape) != shape:
        raise DsnetError(
            f"{name} of shape {tuple(tensor.shape)}", f"shape {shape}", "Give one row per body."
        )
