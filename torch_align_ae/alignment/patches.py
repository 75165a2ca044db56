"""The skin cut into patches of a bone or a few, so that all work on a patch stays in the cache.

Few bones move a patch and few joints correct it, so its products are small. Nothing is left out:
a bone or a joint that does not occur has weights or blend shapes of exactly zero there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

# Measured: smaller patches spend their time between operations, larger ones leave the cache.
_LARGEST_MERGED_PATCH = 800


@dataclass(frozen=True)
class Patch:
    """Neighbouring rows of the sorted vertices."""

    vertices: slice
    """Its N rows."""
    bones: Tensor
    """(K,) bones that move it."""
    weights: Tensor
    """(K, N) their skinning weights."""
    features: Tensor
    """(P,) entries of R - I, of all joints but the root, that correct it."""
    posedirs: Tensor
    """(P, 3 N) displacement per unit of each, metres."""

    def blend(self, columns: Tensor, workspace: Tensor) -> Tensor:
        """Each vertex's blended transform (B, 4, 3, N) of bones' columns (J, B, 4, 3).

        The result lies in `workspace`, which has room for the largest patch.
        """
        _, count, *_ = columns.shape
        size = self.weights.shape[1]
        out = workspace[: count * 12 * size].view(count * 12, size)
        chosen = columns.index_select(0, self.bones).flatten(1)
        return torch.mm(chosen.T, self.weights, out=out).view(count, 4, 3, size)

    def rest(self, shaped: Tensor, features: Tensor) -> Tensor:
        """Shaped vertices (B, 3, V) of the patch plus pose blend shapes of features (B, 9 J)."""
        shaped = shaped[:, :, self.vertices]
        if not len(self.features):
            return shaped
        corrective = features.index_select(1, self.features) @ self.posedirs
        return corrective.view(len(shaped), 3, -1).add_(shaped)

    def add_by_bones(self, planes: Tensor, by_bones: Tensor) -> None:
        """Add a patch's (B, 4, 3, N) values, weighted and summed, to `by_bones` (J, B * 12)."""
        by_bones.index_add_(0, self.bones, self.weights @ planes.flatten(0, 2).T)

    def add_by_features(self, rest_pull: Tensor, by_features: Tensor) -> None:
        """Add the derivative by the features to `by_features` (B, 9 J)."""
        if len(self.features):
            by_features.index_add_(1, self.features, rest_pull.flatten(1) @ self.posedirs.T)


def cut_into_patches(
    weights: Tensor, posedirs: Tensor, parents: Sequence[int]
) -> tuple[Tensor, list[Patch]]:
    """Order of the vertices (V,) that sorts them by patch, and the patches.

    Parameters
    ----------
    weights : (J, V) skinning weights.
    posedirs : (9 (J - 1), 3, V) pose blend shapes, metres.
    parents : parent of each joint; the root's is -1.
    """
    main_bone = weights.argmax(0)
    sizes = torch.bincount(main_bone, minlength=len(weights)).tolist()
    patch_of_vertex = torch.tensor(_merge_small(sizes, parents))[main_bone]
    order = torch.argsort(patch_of_vertex, stable=True)
    ends = torch.bincount(patch_of_vertex).cumsum(0).tolist()
    return order, [
        _patch(slice(start, end), weights[:, order[start:end]], posedirs[:, :, order[start:end]])
        for start, end in zip([0, *ends[:-1]], ends, strict=True)
        if end > start
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


def _patch(vertices: slice, weights: Tensor, posedirs: Tensor) -> Patch:
    bones = weights.any(1).nonzero()[:, 0]
    features = posedirs.flatten(1).any(1).nonzero()[:, 0]
    return Patch(
        vertices,
        bones,
        weights[bones].contiguous(),
        features,
        posedirs[features].flatten(1).contiguous(),
    )
