"""Aligning sequences: every frame on its own, once its subject is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from bridge.motion import pack_theta
from bridge.paper import N_JOINTS
from torch_align_ae.alignment.robust.calibration import (
    BATCH,
    LearnedSubject,
    calibrate,
    fit_unloaded,
)
from torch_align_ae.alignment.robust.initial_pose import initial_pose
from torch_align_ae.alignment.robust.loads import Loads, Observed
from torch_align_ae.alignment.robust.recording import FrameWindow, MeshRecording, windows
from torch_align_ae.alignment.robust.sample import SkinSample
from torch_align_ae.alignment.robust.settings import RobustSettings
from torch_align_ae.body import SMPL
from torch_align_ae.body.rotations import matrix_to_axis_angle, nearest_turns
from torch_align_ae.workers import torch_workers

# Read and fitted by one thread at a time.
FRAMES_PER_WINDOW = 2 * BATCH


def align_sequences(
    smpl: SMPL,
    meshes: Sequence[NDArray[np.float32]],
    subjects: Sequence[int],
    settings: RobustSettings,
    fps: float = 60.0,
    law: type[Loads] = Loads,
) -> tuple[NDArray[np.float32], list[NDArray[np.float32]]]:
    """Shapes and poses of sequences that are in memory.

    Parameters
    ----------
    smpl : the body model.
    meshes : for each sequence (T, V, 3), metres.
    subjects : for each sequence the row of its subject, 0 to S - 1.
    fps : frames per second.
    law : the loads that are taken out.

    Returns
    -------
    betas : (S, 10).
    thetas : for each sequence (T, 69).
    """
    sample = SkinSample(smpl, settings.vertices)
    loads = law.of(sample)
    recordings = [
        MeshRecording(lambda start, stop, own=own: own[start:stop], len(own), fps) for own in meshes
    ]
    thetas = [np.empty((len(own), 3 * N_JOINTS + 3), np.float32) for own in meshes]
    with torch_workers("threads", sample) as pool:
        own = [
            [recording for recording, subject in zip(recordings, subjects, strict=True)
             if subject == row]
            for row in range(max(subjects) + 1)
        ]  # fmt: skip
        known = [calibrate(sample, loads, recorded, settings, pool) for recorded in own]

        def fit(sample: SkinSample, window: FrameWindow) -> tuple[FrameWindow, Tensor, Tensor]:
            _, seen = loads.observe(recordings[window.row], window.start, window.stop)
            return window, *fit_frames(sample, loads, known[subjects[window.row]], seen, settings)

        cut = windows([len(own) for own in meshes], FRAMES_PER_WINDOW)
        for window, pose, trans in pool.map(fit, cut):
            rows = thetas[window.row]
            before = rows[window.start - 1] if window.start else None
            rows[window.start : window.stop] = continued_theta(pose, trans, before)
    return torch.stack([subject.betas for subject in known]).numpy(), thetas


def fit_frames(
    sample: SkinSample,
    loads: Loads,
    subject: LearnedSubject,
    seen: Observed,
    settings: RobustSettings,
) -> tuple[Tensor, Tensor]:
    """Pose (n, 22, 3) axis-angle and translation (n, 3) of frames of a known subject."""
    shaped, tissue = sample.shaped(subject.betas), subject.tissue
    poses = [
        fit_unloaded(
            sample,
            loads,
            shaped,
            tissue,
            part,
            initial_pose(sample, shaped, part.vertices),
            settings.steps,
        )
        for part in seen.split(BATCH)
    ]
    rotations = torch.cat([pose.rotations for pose in poses])
    return matrix_to_axis_angle(rotations), torch.cat([pose.trans for pose in poses])


def continued_theta(
    pose: Tensor, trans: Tensor, before: NDArray[np.float32] | None
) -> NDArray[np.float32]:
    """theta (n, 69) whose turns go on from the frame `before` (69,) without jumps of 2 pi."""
    last = None if before is None else torch.from_numpy(before[: 3 * N_JOINTS]).view(N_JOINTS, 3)
    return pack_theta(nearest_turns(pose, last).numpy(), trans.numpy())
