"""The frames on which subspaces are fitted and scored, and PCA of the first."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from benchmarks.subspaces.residual import RESIDUAL_WIDTH
from bridge.motion import sequences_of
from bridge.motion.splits import FrameSplit, SplitName, held_out_frames, split_autoencoder_frames
from bridge.runs import Artifact
from torch_align_ae.autoencoder.codes import PcaCodec


@dataclass
class SubspaceData:
    """Aligned offsets and who is trained on what."""

    offsets_m: NDArray[np.float32]
    """(F, V, 3), memory-mapped."""
    split: FrameSplit
    """Training and validation frames, both without the held-out sequences."""
    held_out: NDArray[np.int64]
    """Frames of the held-out sequences."""
    seed: int
    """Of the split, of PCA's beginning, of the networks' weights and of the order of frames."""
    fit_s: float = 0.0
    """Seconds that PCA took, once it was asked for."""

    @classmethod
    def of(cls, align: Artifact, split: SplitName, seed: int) -> SubspaceData:
        """From an alignment, split as the stage `train-ae` splits it by default."""
        index = sequences_of(align)
        drawn = split_autoencoder_frames(index, seed, by=split, include_held_out=False)
        return cls(align.array("offsets"), drawn, held_out_frames(index), seed)

    @cached_property
    def pca(self) -> PcaCodec:
        """As many components as the residual autoencoder's units have features."""
        started = time.perf_counter()
        codec = PcaCodec.fit(self.offsets_m, self.split.train, RESIDUAL_WIDTH, seed=self.seed)
        self.fit_s = time.perf_counter() - started
        return codec

    def leading(self, size: int) -> PcaCodec:
        """PCA with its `size` leading components only."""
        return PcaCodec(self.pca.mean_m, self.pca.components[:size])
