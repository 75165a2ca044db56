"""The skin cut into patches of a bone or a few, and the mesh distance's work on one of them.

Few bones move a patch and few joints correct it, so its products are small and all of them stay in
the cache. Nothing is left out: a bone or a joint that does not occur has weights or blend shapes of
exactly zero there.

With w_k the weights, T_k = [R_k t_k] the bones' transforms and x the rest vertex of a patch, the
posed vertex less the mesh's is r = sum_k w_k (R_k x + t_k) - s. Of half the squared distance, |r|^2
/ 2, the derivatives are r by t, r x^T by R (both blended, so weighted by w_k for bone k) and
(sum_k w_k R_k)^T r by x, and what x gets the blend shapes pass on to their features.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

# Measured: smaller patches spend their time between operations, larger ones leave the cache.
_LARGEST_MERGED_PATCH = 800


@dataclass(frozen=True)
class SkinPatch:
    """N vertices that few bones move."""

    vertices: Tensor
    """(N,) which they are."""
    bones: Tensor
    """(K,) bones that move them."""
    weights: Tensor
    """(K, N) their skinning weights."""
    features: Tensor
    """(P,) entries of R - I, of all joints but the root, that correct them."""
    posedirs: Tensor
    """(P, 3 N) displacement per unit of each, metres: all x, all y, all z."""
    posedirs_by_row: Tensor
    """(3 N, P) the same once more: sums over vertices are three times faster in this order."""


def cut_into_patches(weights: Tensor, posedirs: Tensor, parents: Sequence[int]) -> list[SkinPatch]:
    """Patches that hold every vertex once.

    Parameters
    ----------
    weights : (J, V) skinning weights.
    posedirs : (9 (J - 1), 3, V) pose blend shapes, metres.
    parents : parent of each joint; the root's is -1.
    """
    main_bone = weights.argmax(0)
    sizes = torch.bincount(main_bone, minlength=len(weights)).tolist()
    patch_of_vertex = torch.tensor(_merge_small(sizes, parents))[main_bone]
    return [
        _patch((patch_of_vertex == patch).nonzero()[:, 0], weights, posedirs)
        for patch in patch_of_vertex.unique()
    ]


def _merge_small(sizes: list[int], parents: Sequence[int]) -> list[int]:
    """For each bone, the bone that stands for its patch: children join parents while they fit."""
    sizes, joined = list(sizes), list(range(len(sizes)))
    for bone in range(len(sizes) - 1, 0, -1):
        parent = parents[bone]
        if sizes[bone] + sizes[parent] <= _LARGEST_MERGED_PATCH:
            sizes[parent] += sizes[bone]
            joined[bone] = parent
    for bone in range(1, len(sizes)):
        joined[bone] = joined[joined[bone]]
    return joined


def _patch(vertices: Tensor, weights: Tensor, posedirs: Tensor) -> SkinPatch:
    weights, posedirs = weights[:, vertices], posedirs[:, :, vertices].flatten(1)
    bones = weights.any(1).nonzero()[:, 0]
    features = posedirs.any(1).nonzero()[:, 0]
    posedirs = posedirs[features]
    return SkinPatch(vertices, bones, weights[bones], features, posedirs, posedirs.T.contiguous())


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
        """Distances (B,) of the posed patch, metres; residuals stay in the memory for `pull`.

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
        """Derivatives at what `skin` was called with, once: they overwrite its transforms."""
        (row, residual), *others = self._unskinning
        torch.mul(row, residual, out=self._by_shaped)
        for row, residual in others:
            self._by_shaped.addcmul_(row, residual)
        torch.mul(self._rest_columns, self._residual_rows, out=self._turn)
        torch.mm(self._patch.weights, self._planes.T, out=self.by_bones)
        torch.mm(self.by_shaped, self._patch.posedirs_by_row, out=self.by_features)
