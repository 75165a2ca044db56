"""The robust aligner on meshes that are in memory, with any law of tissue."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bridge.motion import MotionSequence
from torch_align_ae.alignment.robust import RobustFit, RobustSettings
from torch_align_ae.alignment.tissue import Loads, MeshRecording
from torch_align_ae.body import SMPL
from torch_align_ae.corpus.dyna_files import FPS


def align_sequences(
    smpl: SMPL,
    meshes: Sequence[NDArray[np.float32]],
    subjects: Sequence[int],
    settings: RobustSettings,
    law: type[Loads] = Loads,
) -> tuple[NDArray[np.float32], list[NDArray[np.float32]]]:
    """Shapes (S, 10), and theta (T, 69) of each sequence.

    `meshes` are (T, V, 3), metres, `subjects` the rows of their subjects, 0 to S - 1; `law` is the
    loads that are taken out.
    """
    sequences = [
        MotionSequence(f"{row}", f"{subject}", "", 0, len(own), FPS)
        for row, (own, subject) in enumerate(zip(meshes, subjects, strict=True))
    ]
    recordings = [
        MeshRecording(lambda start, stop, own=own: own[start:stop], len(own), FPS) for own in meshes
    ]
    fit = RobustFit(smpl, recordings, sequences, settings, law)
    learned, groups = fit.learn(), fit.groups()
    thetas = iter(list(fit.fit(learned, groups, files=None)))
    together = [np.concatenate([next(thetas) for _ in group]) for group in groups]
    return learned["betas"], together
