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
