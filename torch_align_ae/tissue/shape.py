"""What a body's shape says of its tissue, in PyTorch: differentiable by the betas.

`bridge.tissue.shape` has the same in NumPy, and the meaning.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bridge.body import BodyModelData
from bridge.tissue.shape import LEAST_DEPTH_M, ends_of_bones, faces_around, shape_measures
from torch_align_ae.body.smpl import register_constants


class NodeShapes(nn.Module):
    """K nodes on the skin of people of a body model with S shapes."""

    template: Tensor
    shapedirs: Tensor
    joints: Tensor
    joint_shapes: Tensor
    measures: Tensor
    faces: Tensor
    around: Tensor
    nodes: Tensor
    bones: Tensor

    def __init__(
        self,
        body: BodyModelData,
        nodes: NDArray,
        measures: NDArray | None,
        dtype: torch.dtype,
    ) -> None:
        super().__init__()
        if measures is None:
            measures = shape_measures(body, np.zeros(body.shapedirs.shape[-1]), nodes)
        ends = ends_of_bones(body.joints, body.parents)
        numbers = {
            "template": body.v_template,
            "shapedirs": body.shapedirs.transpose(2, 0, 1),
            "joints": body.joints,
            "joint_shapes": body.joint_shapes.transpose(2, 0, 1),
            "measures": measures,
        }
        indices = {
            "faces": body.faces.T,
            "around": faces_around(body, nodes),
            "nodes": nodes,
            "bones": np.stack([body.parents[ends], ends]),
        }
        register_constants(self, numbers, dtype)
        register_constants(self, indices, torch.int64)

    def forward(self, betas: Tensor) -> tuple[Tensor, Tensor]:
        """Of betas (B, S): `shape_features` (B, K, 3), and outward normals (B, K, 3)."""
        vertices = self.template + torch.tensordot(betas, self.shapedirs, 1)
        joints = self.joints + torch.tensordot(betas, self.joint_shapes, 1)
        first, second, third = (vertices.index_select(1, corners) for corners in self.faces)
        volume = (first * torch.linalg.cross(second, third)).sum((1, 2)) / 6
        heights = vertices[..., 1]
        stature = volume / (heights.amax(1) - heights.amin(1)) ** 3
        of_faces = torch.linalg.cross(second - first, third - first)
        # One more, of no area, is at nodes that have fewer faces than others.
        padded = nn.functional.pad(of_faces, (0, 0, 0, 1))
        adjacent = padded.index_select(1, self.around.flatten())
        adjacent = adjacent.unflatten(1, self.around.shape)  # (B, K, D, 3)
        normals = nn.functional.normalize(adjacent.sum(2), dim=-1)
        areas = _lengths(adjacent).sum(2) / 6
        depths = self._depths(vertices.index_select(1, self.nodes), joints)
        measures = torch.stack([depths, areas, stature[:, None].expand_as(areas)], -1)
        return torch.log(measures / self.measures), normals

    def _depths(self, points: Tensor, joints: Tensor) -> Tensor:
        """Distances (B, K), metres, of points (B, K, 3) from the nearest bone's axis."""
        begins, ends = (joints[:, None, rows] for rows in self.bones)  # (B, 1, bones, 3)
        bones, away = ends - begins, points[:, :, None] - begins
        along = ((away * bones).sum(-1) / bones.square().sum(-1)).clamp(0, 1)
        return _lengths(away - along[..., None] * bones).amin(2).clamp(min=LEAST_DEPTH_M)


def _lengths(vectors: Tensor) -> Tensor:
    """Lengths (...) of vectors (..., 3), of which zeros have the gradient zero."""
    return torch.linalg.vector_norm(vectors, dim=-1)
