"""SMPL in PyTorch: Eq. 1-2, differentiable in every argument.

Inside, coordinates come before vertices, (B, 3, V): every product of skinning is then a stream
over contiguous vertices, which a processor does three times faster than many 3 x 3 products.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from bridge.body import BodyModelData
from bridge.errors import DsnetError
from bridge.paper import N_JOINTS
from torch_align_ae.body.kinematics import bone_transforms, tree_levels
from torch_align_ae.body.rotations import axis_angle_to_matrix


class SMPL(nn.Module):
    """A body model with constant parameters, V = 6890 vertices for SMPL.

    Parameters
    ----------
    data : the body model.
    dtype : of the buffers and of all results. Pass float64 here; `.double()` later would only
        widen values that were already rounded.
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
        self.levels = tree_levels(self.parents)
        joint_shapedirs = [data.J_regressor @ data.shapedirs[:, axis] for axis in range(3)]
        buffers = {
            "template": data.v_template.T,  # (3, V)
            "shapedirs": data.shapedirs.transpose(2, 1, 0),  # (10, 3, V)
            "posedirs": data.posedirs.transpose(2, 1, 0),  # (207, 3, V)
            "weights": data.weights.T,  # (24, V)
            "joint_template": data.joints,  # (24, 3)
            "joint_shapedirs": np.stack(joint_shapedirs, 1).transpose(2, 0, 1),  # (10, 24, 3)
        }
        for name, array in buffers.items():
            tensor = torch.from_numpy(np.ascontiguousarray(array)).to(dtype)
            self.register_buffer(name, tensor, persistent=False)

    @property
    def vertex_count(self) -> int:
        """Number of vertices, V."""
        return self.template.shape[1]

    def moving_weights(self) -> Tensor:
        """(22, V) skinning weights of the joints that theta moves: the hands' are the wrists'."""
        weights = self.weights[:N_JOINTS].clone()
        for hand in range(N_JOINTS, len(self.parents)):
            weights[self.parents[hand]] += self.weights[hand]
        return weights

    def forward(
        self, betas: Tensor, pose: Tensor, trans: Tensor, offsets: Tensor | None = None
    ) -> Tensor:
        """Posed vertices, Eq. 1-2.

        Parameters
        ----------
        betas : (B, 10) shape.
        pose : (B, 22, 3) or (B, 24, 3) axis-angle, radians; missing hand joints stay at rest.
        trans : (B, 3) translation, metres.
        offsets : (B, V, 3) displacement added in the rest pose, metres, or None.

        Returns
        -------
        (B, V, 3) vertices, metres.

        Raises
        ------
        DsnetError
            If an argument has the wrong shape.
        """
        rotations = self.rotations(pose)
        rest = self.planar_rest(betas, rotations)
        if offsets is not None:
            _check_shape("offsets", offsets, (len(betas), self.vertex_count, 3))
            rest = rest + offsets.transpose(1, 2)
        blended = self.blended_transforms(betas, rotations, trans)
        posed = (blended[:, :, :3] * rest[:, None]).sum(2) + blended[:, :, 3]
        return posed.transpose(1, 2).contiguous()

    def rest(self, betas: Tensor) -> tuple[Tensor, Tensor]:
        """Shaped body of the template pose, M_S: vertices (B, V, 3) and joints (B, 24, 3), m."""
        return self._planar_shaped(betas).transpose(1, 2), self.joints(betas)

    def rest_vertices(self, betas: Tensor, pose: Tensor) -> Tensor:
        """(B, V, 3) shaped body with pose blend shapes, before skinning (Eq. 2), metres."""
        return self.planar_rest(betas, self.rotations(pose)).transpose(1, 2)

    def joints(self, betas: Tensor) -> Tensor:
        """(B, 24, 3) joints of the shaped body in the rest pose, metres."""
        _check_shape("betas", betas, (len(betas), len(self.shapedirs)))
        return self.joint_template + torch.tensordot(betas, self.joint_shapedirs, dims=1)

    def rotations(self, pose: Tensor) -> Tensor:
        """(B, 24, 3, 3) rotation of each joint from (B, 22, 3) or (B, 24, 3) axis-angle."""
        if pose.ndim != 3 or pose.shape[1:] not in ((22, 3), (24, 3)):
            raise DsnetError(
                f"pose of shape {tuple(pose.shape)}",
                "(B, 22, 3) or (B, 24, 3)",
                "Pass axis-angle vectors, not the flat theta of 69 numbers.",
            )
        missing = len(self.parents) - pose.shape[1]
        return axis_angle_to_matrix(nn.functional.pad(pose, (0, 0, 0, missing)))

    def planar_rest(self, betas: Tensor, rotations: Tensor) -> Tensor:
        """Eq. 2 as (B, 3, V)."""
        identity = torch.eye(3, dtype=rotations.dtype, device=rotations.device)
        features = (rotations[:, 1:] - identity).flatten(1)
        corrective = features @ self.posedirs.flatten(1)
        return self._planar_shaped(betas) + corrective.unflatten(1, (3, -1))

    def blended_transforms(self, betas: Tensor, rotations: Tensor, trans: Tensor) -> Tensor:
        """Each vertex's weighted mean of the bones' transforms, (B, 3, 4, V), rest to world."""
        _check_shape("trans", trans, (len(betas), 3))
        bones = bone_transforms(rotations, self.joints(betas), self.levels, trans)
        planar = bones.permute(0, 2, 3, 1).reshape(-1, len(self.parents))
        return (planar @ self.weights).unflatten(0, (-1, 3, 4))

    def _planar_shaped(self, betas: Tensor) -> Tensor:
        _check_shape("betas", betas, (len(betas), len(self.shapedirs)))
        shape = betas @ self.shapedirs.flatten(1)
        return self.template + shape.unflatten(1, (3, -1))


def _check_shape(name: str, tensor: Tensor, shape: tuple[int, ...]) -> None:
    if tuple(tensor.shape) != shape:
        raise DsnetError(
            f"{name} of shape {tuple(tensor.shape)}", f"shape {shape}", "Give one row per body."
        )
