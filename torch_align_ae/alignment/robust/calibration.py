"""A subject as the robust aligner knows it: shape and tissue, learned from some of its frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np
import torch
from torch import Tensor

from bridge.runs.worker_pool import WorkerPool
from torch_align_ae.alignment.robust.gauss_newton import fit_poses
from torch_align_ae.alignment.robust.initial_pose import initial_pose
from torch_align_ae.alignment.robust.recording import MeshRecording, spread_clips
from torch_align_ae.alignment.robust.sample import Pose, SkinSample
from torch_align_ae.alignment.robust.settings import RobustSettings
from torch_align_ae.alignment.robust.shape import fit_shape
from torch_align_ae.alignment.robust.tissue import Evidence, Tissue

# Bodies fitted as one batch: fewer waste time between operations, more fall out of the cache.
BATCH = 32
# Steps with all vertices alike, from the closed form to where residuals mean something.
_FIRST_STEPS = 2


@dataclass(frozen=True)
class LearnedSubject:
    """What is learned of a subject once."""

    betas: Tensor
    """(10,) shape."""
    tissue: Tissue
    """Mechanics of the sample's vertices."""


@dataclass
class _Batch:
    """Some calibration frames and their poses so far."""

    vertices: Tensor
    acceleration: Tensor
    pose: Pose


def calibrate(
    sample: SkinSample,
    recordings: Sequence[MeshRecording],
    settings: RobustSettings,
    pool: WorkerPool[SkinSample],
) -> LearnedSubject:
    """Learn the shape and then how soft the body is where, from frames of all its recordings."""
    betas = fit_shape(sample, _shape_frames(sample, recordings, settings), settings.shape_steps)
    shaped = sample.shaped(betas)
    clips = [
        [sample.take(part) for part in recording.meshes(start, stop)]
        for recording, start, stop in spread_clips(recordings, settings.calibration_frames)
    ]
    vertices, acceleration = (torch.cat(parts) for parts in zip(*clips, strict=True))
    if not settings.inertia:
        acceleration.zero_()
    tissue = Tissue.unknown(sample.weights)

    def start(sample: SkinSample, part: tuple[Tensor, Tensor]) -> _Batch:
        pose = initial_pose(sample, shaped, part[0])
        equal = tissue.weights(settings.precision_m)
        return _Batch(*part, fit_poses(sample, shaped, part[0], equal, pose, _FIRST_STEPS))

    def gather(sample: SkinSample, batch: _Batch) -> Evidence:
        displacement = batch.vertices - sample.positions(shaped, batch.pose)
        return Evidence.of(displacement, batch.acceleration)

    def improve(sample: SkinSample, batch: _Batch) -> Evidence:
        target = tissue.target(batch.vertices, batch.acceleration)
        weights = tissue.weights(settings.precision_m)
        batch.pose = fit_poses(sample, shaped, target, weights, batch.pose, 1)
        return gather(sample, batch)

    parts = zip(vertices.split(BATCH), acceleration.split(BATCH), strict=True)
    batches = list(pool.map(start, parts))
    tissue = reduce(add, pool.map(gather, batches)).revise(tissue)
    for _ in range(settings.calibration_rounds):
        tissue = reduce(add, pool.map(improve, batches)).revise(tissue)
    return LearnedSubject(betas, tissue)


def _shape_frames(
    sample: SkinSample, recordings: Sequence[MeshRecording], settings: RobustSettings
) -> Tensor:
    """(n, 3, N) the frames that give the shape: the first, or some spread over all recordings."""
    if settings.shape_frames == 1:
        return sample.take(torch.from_numpy(recordings[0].read(0, 1)))
    ends = np.cumsum([recording.length for recording in recordings])
    frames = []
    for place in np.linspace(0, ends[-1] - 1, settings.shape_frames).astype(int):
        row = int(np.searchsorted(ends, place, side="right"))
        within = int(place - (ends[row] - recordings[row].length))
        frames.append(torch.from_numpy(recordings[row].read(within, within + 1)))
    return sample.take(torch.cat(frames))
