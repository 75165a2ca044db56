"""A subject as the robust aligner knows it: shape and tissue, learned from some of its frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np
import torch
from torch import Tensor

from bridge.runs.workers import WorkerPool
from torch_align_ae.alignment.robust.gauss_newton import fit_poses
from torch_align_ae.alignment.robust.initial_pose import initial_pose
from torch_align_ae.alignment.robust.loads import Loads, Observed
from torch_align_ae.alignment.robust.recording import (
    MeshRecording,
    noise_variance,
    shared_noise,
    spread_clips,
)
from torch_align_ae.alignment.robust.sample import Pose, Shaped, SkinSample
from torch_align_ae.alignment.robust.settings import RobustSettings
from torch_align_ae.alignment.robust.shape import ShapeEvidence, fit_shape, shape_evidence
from torch_align_ae.alignment.robust.tissue import Evidence, Tissue

# Bodies fitted as one batch: fewer waste time between operations, more fall out of the cache.
BATCH = 32
# Gauss-Newton steps for the shape of the first frame.
_SHAPE_STEPS = 8
# Steps with all vertices alike, from the closed form to where residuals mean something.
_FIRST_STEPS = 2
# The shape moves slowly and its equations cost as much as a round.
_ROUNDS_PER_SHAPE = 2


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

    seen: Observed
    pose: Pose


def calibrate(
    sample: SkinSample,
    loads: Loads,
    recordings: Sequence[MeshRecording],
    settings: RobustSettings,
    pool: WorkerPool[SkinSample],
) -> LearnedSubject:
    """Learn the shape and then how soft the body is where, from frames of all its recordings.

    The first frame's tissue hangs and moves, and a shape fitted to it keeps that for ever. So once
    the loads are known the shape is corrected, round by round, by all frames without theirs.
    """
    first = sample.take(torch.from_numpy(recordings[0].read(0, 1)))
    betas = fit_shape(sample, first, _SHAPE_STEPS)
    shaped = sample.shaped(betas)

    def start(sample: SkinSample, seen: Observed) -> _Batch:
        pose = initial_pose(sample, shaped, seen.vertices)
        alike = seen.vertices.new_ones(len(sample))
        return _Batch(seen, fit_poses(sample, shaped, seen.vertices, alike, pose, _FIRST_STEPS))

    def gather(sample: SkinSample, batch: _Batch) -> Evidence:
        displacement = batch.seen.vertices - sample.positions(shaped, batch.pose)
        turn = sample.frames(shaped, batch.pose).turn
        terms = loads.terms(batch.seen, turn)
        return Evidence.of(displacement, terms).less_noise(noise * loads.noise_in_common(terms))

    def improve(sample: SkinSample, batch: _Batch) -> Evidence:
        batch.pose = fit_unloaded(sample, loads, shaped, tissue, batch.seen, batch.pose, 1)
        return gather(sample, batch)

    def about_shape(sample: SkinSample, batch: _Batch) -> ShapeEvidence:
        terms = loads.terms(batch.seen, sample.frames(shaped, batch.pose).turn)
        target, weights = tissue.unloaded(batch.seen.vertices, terms), tissue.weights(precision)
        return shape_evidence(sample, shaped, batch.pose, target, weights)

    precision = loads.precision_m
    clips = [
        loads.observe(recording, start, stop)[1]
        for recording, start, stop in spread_clips(recordings, settings.calibration_frames)
    ]
    variance_m2 = _noise_variance(loads, clips)
    noise = shared_noise(variance_m2, recordings[0].fps)
    seen = Observed(*(torch.cat(parts) for parts in zip(*clips, strict=True)))
    batches = list(pool.map(start, seen.split(BATCH)))
    evidence = reduce(add, pool.map(gather, batches))
    noise_m = np.sqrt(variance_m2) if variance_m2 > precision**2 else 0.0
    tissue = evidence.revise(Tissue.unknown(evidence.pull.shape[1], sample.weights, noise_m))
    for turn in range(settings.calibration_rounds):
        tissue = reduce(add, pool.map(improve, batches)).revise(tissue)
        if turn % _ROUNDS_PER_SHAPE == _ROUNDS_PER_SHAPE - 1:
            told = reduce(ShapeEvidence.plus, pool.map(about_shape, batches))
            betas = betas + told.change().to(betas)
            shaped = sample.shaped(betas)
    return LearnedSubject(betas, tissue)


def fit_unloaded(
    sample: SkinSample,
    loads: Loads,
    shaped: Shaped,
    tissue: Tissue,
    seen: Observed,
    pose: Pose,
    steps: int,
) -> Pose:
    """Poses of the sample without its loads; which those are follows the pose, step by step."""
    weights = tissue.weights(loads.precision_m)
    for _ in range(steps):
        terms = loads.terms(seen, sample.frames(shaped, pose).turn)
        pose = fit_poses(sample, shaped, tissue.unloaded(seen.vertices, terms), weights, pose, 1)
    return pose


def _noise_variance(loads: Loads, clips: Sequence[Observed]) -> float:
    """m^2, of the clip in the middle: some hardly move, some violently."""
    return float(np.median([noise_variance(clip.vertices, loads.around) for clip in clips]))
