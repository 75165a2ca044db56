"""The robust aligner without its law of tissue, for the studies that ask what the law is worth."""

from __future__ import annotations

from torch import Tensor

from torch_align_ae.alignment.tissue import Loads, Observed


class WeightsAlone(Loads):
    """No load is taken out: vertices are only weighted by how little they jiggle."""

    def terms(self, seen: Observed, turn: Tensor) -> Tensor:
        """None, (0, B, 3, N)."""
        return seen.vertices.new_zeros(0, *seen.vertices.shape)

    def noise_in_common(self, terms: Tensor) -> Tensor:
        """None, (0, N)."""
        return terms.new_zeros(0, terms.shape[-1])
