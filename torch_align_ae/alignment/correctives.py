"""Pose blend shapes as a linear operator, sparse where the body model allows it."""

from __future__ import annotations

import warnings

import torch
from torch import Tensor

# Measured: a sparse product beats a dense one below this share of non-zeros. The embedded
# bodies have 4 %, because a joint corrects the skin around it only; SMPL's own files are dense.
_SPARSE_BELOW = 0.15


class PoseCorrectives:
    """M_P(theta) of Eq. 2 for a batch, and its transpose.

    Parameters
    ----------
    posedirs : (9 J, 3, V) displacement per unit of (R - I) of each joint but the root, metres.
    """

    def __init__(self, posedirs: Tensor) -> None:
        by_feature = posedirs.flatten(1)
        self._identity = torch.eye(3, dtype=posedirs.dtype).flatten()
        if torch.count_nonzero(by_feature) < _SPARSE_BELOW * by_feature.numel():
            self._by_feature, self._by_vertex = _csr(by_feature), _csr(by_feature.T)
        else:
            self._by_feature, self._by_vertex = by_feature, by_feature.T

    def add_to(self, vertices: Tensor, rotations: Tensor) -> Tensor:
        """Vertices (B, 3, V) plus the correctives of rotations (B, 1 + J, 3, 3), root first."""
        features = (rotations[:, 1:].flatten(2) - self._identity).flatten(1)
        return vertices + (self._by_vertex @ features.T).T.view_as(vertices)

    def gradient(self, rest_pull: Tensor) -> Tensor:
        """Derivative (B, J, 3, 3) by the rotations from the one by rest vertices (B, 3, V)."""
        features = (self._by_feature @ rest_pull.flatten(1).T).T
        return features.unflatten(1, (-1, 3, 3))


def _csr(matrix: Tensor) -> Tensor:
    with warnings.catch_warnings():
        # PyTorch calls its compressed sparse rows a beta feature; the products are tested here.
        warnings.filterwarnings("ignore", "Sparse CSR", UserWarning)
        return matrix.to_sparse_csr()
