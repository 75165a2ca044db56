"""Where nodes on the skin are and how they are turned, and the skin between them, in PyTorch."""

from __future__ import annotations

import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bridge.body import BodyModelData
from bridge.paper import N_JOINTS
from bridge.tissue.nodes import TissueNodes
from torch_align_ae.body.rotations import axis_angle_to_matrix
from torch_align_ae.body.smpl import bone_transforms, register_constants

POSE_FEATURES = 9 * (N_JOINTS - 1)
"""How many: R - I of the joints of theta without the root."""
_ROWS = 64
"""Frames of all people that are interpolated together."""


class Kinematics(nn.Module):
    """Skinning (Eq. 1-2) of K of a body's vertices, on planes (B, 3, K) as in `SMPL`.

    theta has no hands: they stay in their rest pose relative to the wrists.
    """

    template: Tensor
    shapedirs: Tensor
    posedirs: Tensor
    weights: Tensor
    joints: Tensor
    joint_shapes: Tensor
    skin_weights: Tensor

    def __init__(self, body: BodyModelData, nodes: NDArray, dtype: torch.dtype) -> None:
        super().__init__()
        self._parents: tuple[int, ...] = tuple(body.parents[:N_JOINTS].tolist())
        posedirs = body.posedirs[nodes].transpose(2, 1, 0)[:POSE_FEATURES]
        buffers = {
            "template": body.v_template[nodes].T,
            "shapedirs": body.shapedirs[nodes].transpose(2, 1, 0),
            "posedirs": posedirs.reshape(POSE_FEATURES, -1),
            "weights": body.body_weights[nodes].T,
            "joints": body.joints[:N_JOINTS],
            "joint_shapes": body.joint_shapes[:N_JOINTS].transpose(2, 0, 1),
            "skin_weights": body.body_weights.T,
        }
        register_constants(self, buffers, dtype)

    def forward(self, rotations: Tensor, betas: Tensor) -> tuple[Tensor, Tensor]:
        """Places (B, T, 3, K), metres from where the root is, and turns (B, T, 3, 3, K), the
        linear part of skinning, of rotations (B, T, 22, 3, 3) and betas (B, S)."""
        count = rotations.shape[1]
        joints = self.joints + torch.tensordot(betas, self.joint_shapes, 1)
        shape = self.template + torch.tensordot(betas, self.shapedirs, 1)
        rest = (pose_features(rotations) @ self.posedirs).unflatten(2, (3, -1)) + shape[:, None]
        still = torch.zeros_like(joints[:, :1, 0]).expand(-1, count).flatten()
        bones = bone_transforms(
            rotations.flatten(0, 1),
            joints[:, None].expand(-1, count, -1, -1).flatten(0, 1),
            self._parents,
            still[:, None].expand(-1, 3),
        )
        blended = _blended(bones, self.weights).unflatten(0, (-1, count))  # (B, T, 3, 4, K)
        turns = blended[:, :, :, :3]
        return (turns * rest[:, :, None]).sum(3) + blended[:, :, :, 3], turns

    def turned(self, rotations: Tensor, offsets_m: Tensor) -> Tensor:
        """Offsets (B, T, V, 3) of all vertices, from the rest pose to the world's frame."""
        flat = rotations.flatten(0, 1)
        joints = torch.zeros_like(flat[..., 0])  # a turn does not depend on places
        bones = bone_transforms(flat, joints, self._parents, joints[:, 0])
        turns = _blended(bones, self.skin_weights)[:, :, :3].unflatten(0, rotations.shape[:2])
        return (turns * offsets_m.transpose(2, 3)[:, :, None]).sum(3).transpose(2, 3)


def joint_rotations(theta: Tensor) -> Tensor:
    """Rotations (B, T, 22, 3, 3) of poses theta (B, T, 69)."""
    return axis_angle_to_matrix(theta[..., : 3 * N_JOINTS].unflatten(-1, (N_JOINTS, 3)))


def pose_features(rotations: Tensor) -> Tensor:
    """R - I (B, T, 189) of all joints but the root."""
    identity = torch.eye(3, dtype=rotations.dtype, device=rotations.device)
    return (rotations[:, :, 1:] - identity).flatten(2)


def _blended(bones: Tensor, weights: Tensor) -> Tensor:
    """Transforms (B, 3, 4, K) of vertices with weights (J, K), of bones (B, J, 3, 4)."""
    # Weights sum to 1 only up to rounding; blended this way, standing is no turn exactly.
    identity = torch.eye(3, 4, dtype=bones.dtype, device=bones.device)
    moved = (bones - identity).permute(0, 2, 3, 1).flatten(1, 2)
    return (moved @ weights).unflatten(1, (3, 4)) + identity[..., None]


class NodesToSkin(nn.Module):
    """Interpolation from K nodes to V vertices, each of which eight nodes share.

    Blocks of consecutive vertices have few nodes: their dense products are faster than gathering,
    and unlike PyTorch's sparse products they are the same on any device.
    """

    nodes: Tensor
    shares: Tensor

    def __init__(self, nodes: TissueNodes, dtype: torch.dtype) -> None:
        super().__init__()
        self._vertices = len(nodes.owners)
        of_blocks, shares = nodes.blocks()
        register_constants(self, {"nodes": of_blocks}, torch.int64)
        register_constants(self, {"shares": shares}, dtype)

    def forward(self, at_nodes: Tensor) -> Tensor:
        """Offsets (B, T, V, 3) of offsets (B, T, 3, K)."""
        # Some frames at a time: what is gathered of them stays in a core's cache.
        pieces = at_nodes.split(max(_ROWS // len(at_nodes), 1), 1)
        skin = torch.cat([self._some(piece) for piece in pieces], 1)
        return skin.flatten(2, 3)[:, :, : self._vertices]

    def _some(self, at_nodes: Tensor) -> Tensor:
        """(B, T', blocks, 106, 3)."""
        # As `index_select`, whose gradient is many times faster than that of an index.
        rows = at_nodes.flatten(0, 2).T.index_select(0, self.nodes.flatten())
        rows = rows.unflatten(0, self.nodes.shape)  # (blocks, near, 3 B T')
        skin = rows.transpose(1, 2) @ self.shares  # (blocks, 3 B T', 106)
        return skin.unflatten(1, at_nodes.shape[:3]).permute(1, 2, 0, 4, 3)
