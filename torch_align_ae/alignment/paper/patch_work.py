"""What the mesh distance computes on one patch of the skin, for a batch of bodies."""

from __future__ import annotations

import torch
from torch import Tensor

from torch_align_ae.alignment.paper.patches import SkinPatch


class PatchWork:
    """A patch of N vertices and the memory for a batch's work on it.

    Every view of the memory is made once: at each step views would cost as much as the
    arithmetic, and fresh pages more.

    Parameters
    ----------
    patch : the patch, moved by K bones and corrected by P features.
    target : (B, 3 N) meshes, metres: all x, all y, all z.
    planes, rest : memory for (B, 12 N) and (B, 3 N) numbers or more, which other patches overwrite.
    """

    def __init__(self, patch: SkinPatch, target: Tensor, planes: Tensor, rest: Tensor) -> None:
        self._patch = patch
        count, size = len(target), len(patch.vertices)
        self._target = target.view(count, 3, size)
        # Each vertex's blended transform, columns before rows, and later the derivatives by it.
        self._planes = planes[: count * 12 * size].view(count * 12, size)
        columns = self._planes.view(count, 4, 3, size)
        self._turn, self._residual = columns[:, :3], columns[:, 3]
        self._residual_rows = self._residual[:, None]
        self._rest = rest[: count * 3 * size].view(count, 3 * size)
        self._rest_columns = self._rest.view(count, 3, 1, size)
        self._skinning = list(zip(self._turn.unbind(1), self._rest_columns.unbind(1), strict=True))
        residuals = self._residual[:, :, None].unbind(1)
        self._unskinning = list(zip(self._turn.unbind(2), residuals, strict=True))
        self.by_bones = target.new_zeros(len(patch.bones), count * 12)
        """(K, B * 12) derivatives of half the squared distance by `carrying` of `skin`."""
        self.by_features = target.new_zeros(count, len(patch.features))
        """(B, P) derivatives by `features` of `skin`."""
        self.by_shaped = torch.zeros_like(self._rest)
        """(B, 3 N) derivatives by `shaped` of `skin`."""
        self._by_shaped = self.by_shaped.view(count, 3, size)

    def skin(self, shaped: Tensor, carrying: Tensor, features: Tensor) -> Tensor:
        """Distances (B,) of the posed patch, metres.

        Parameters
        ----------
        shaped : (B, 3 N) patch at rest without pose blend shapes, metres.
        carrying : (B * 12, K) bones' transforms, columns before rows.
        features : (B, P) entries of R - I.
        """
        torch.mm(carrying, self._patch.weights, out=self._planes)
        torch.addmm(shaped, features, self._patch.posedirs, out=self._rest)
        self._residual.sub_(self._target)
        for column, coordinate in self._skinning:
            self._residual.addcmul_(column, coordinate)
        return torch.linalg.vector_norm(self._residual, dim=(1, 2))

    def pull(self) -> None:
        """Derivatives at what `skin` was called with, once: its residuals are used up."""
        (row, residual), *others = self._unskinning
        torch.mul(row, residual, out=self._by_shaped)
        for row, residual in others:
            self._by_shaped.addcmul_(row, residual)
        torch.mul(self._rest_columns, self._residual_rows, out=self._turn)
        torch.mm(self._patch.weights, self._planes.T, out=self.by_bones)
        torch.mm(self.by_shaped, self._patch.posedirs_by_row, out=self.by_features)
