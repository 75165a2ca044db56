"""The robust aligner on meshes that are in memory, with any law of tissue."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.motion import MotionSequence
from bridge.motion.sequences import end_to_end
from bridge.paper import FPS
from bridge.runs import ArtifactWriter
from torch_align_ae.alignment.robust import RobustFit, RobustSettings
from torch_align_ae.alignment.skin_sample import SkinSample
from torch_align_ae.alignment.tissue import Loads
from torch_align_ae.body import SMPL


class InMemory(NamedTuple):
    """`Meshes` that are there: (T, V, 3), metres."""

    meshes_m: NDArray[np.float32]

    def read(self, start: int, stop: int, every: int = 1) -> NDArray[np.float32]:
        """Frames [start, stop) of every so many vertices."""
        return self.meshes_m[start:stop, ::every]


def align_sequences(
    smpl: SMPL,
    meshes: Sequence[NDArray[np.float32]],
    subjects: Sequence[int],
    settings: RobustSettings,
    law: Callable[[SkinSample], Loads] = Loads,
) -> tuple[NDArray[np.float32], list[NDArray[np.float32]]]:
    """Shapes (S, 10), and theta (T, 69) of each sequence.

    `meshes` are (T, V, 3), metres, `subjects` the rows of their subjects, 0 to S - 1; `law` is the
    loads that are taken out.
    """
    sequences = end_to_end(
        [
            MotionSequence(f"{row}", f"{subject}", "", 0, len(own), FPS)
            for row, (own, subject) in enumerate(zip(meshes, subjects, strict=True))
        ]
    )
    recordings = {f"{row}": InMemory(own) for row, own in enumerate(meshes)}
    with tempfile.TemporaryDirectory() as folder:
        writer = ArtifactWriter(Path(folder) / "align", "align", data="synthetic")
        RobustFit(smpl, sequences, recordings, settings, law).write(writer)
        betas, theta = (np.load(writer.file_path(f"{name}.npy")) for name in ("betas", "theta"))
    return betas, [theta[sequence.frames] for sequence in sequences]
