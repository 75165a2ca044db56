"""The robust aligner: poses from vertices whose soft-tissue motion is estimated and removed.

This is not the paper's method. It addresses the limitation in the paper's Section 6 that fitted
poses absorb part of the dynamics; `tissue` explains how. The shape of a subject and the softness of
each vertex are calibrated on some of its frames; then every frame is fitted separately.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from bridge.motion import MotionSequence, pack_theta
from bridge.motion.resampling import continuous_rotations
from bridge.motion.sequences import subjects_of
from bridge.options import NonNegativeInt, PositiveInt
from bridge.paper import N_JOINTS
from bridge.runs.workers import on_any_node, progress, worker_pool
from torch_align_ae.alignment.corpus_fit import AlignedFiles, CorpusFit, Meshes, Window, windows
from torch_align_ae.alignment.gauss_newton import (
    fit_poses,
    fit_shape,
    initial_pose,
    shape_equations,
    solve_damped,
)
from torch_align_ae.alignment.skin_sample import Pose, Shaped, SkinSample
from torch_align_ae.alignment.tissue import (
    Evidence,
    Loads,
    Observed,
    Tissue,
    noise_variance,
    shared_noise,
)
from torch_align_ae.body import SMPL
from torch_align_ae.body.rotations import matrix_to_axis_angle
from torch_align_ae.workers import torch_workers

# Bodies in one batch: fewer have too much overhead, more do not fit into the cache.
_BATCH = 32
# Read and fitted by one thread at a time.
_FRAMES_PER_WINDOW = 2 * _BATCH
# Consecutive frames that are read together for calibration.
_CLIP = 8
# Gauss-Newton steps for the shape of the first frame.
_SHAPE_STEPS = 8
# First steps with equal weights, until the residuals are meaningful.
_FIRST_STEPS = 2
# The shape changes slowly, and its equations take as long as a round.
_ROUNDS_PER_SHAPE = 2
_CALIBRATED = ("betas", "compliance", "deviation", "noise")


@dataclass(frozen=True)
class RobustSettings:
    """How much work the robust aligner does; `docs/alignment.md` shows the effect of each."""

    vertices: PositiveInt = 800
    """About how many vertices of the mesh the pose is fitted to."""
    steps: NonNegativeInt = 4
    """Gauss-Newton steps for each frame."""
    calibration_frames: PositiveInt = 192
    """Frames of each subject, from all of its motions, by which softness is calibrated."""
    calibration_rounds: NonNegativeInt = 12
    """Iterations of the calibration."""

    @classmethod
    def fast(cls) -> RobustSettings:
        return cls(vertices=400, calibration_frames=96)


class RobustFit(CorpusFit):
    """Alignment of a corpus to meshes from which the effect of loads is removed.

    `law` gives the terms by which loads displace soft tissue.
    """

    close_m = 0.03

    def __init__(
        self,
        smpl: SMPL,
        sequences: Sequence[MotionSequence],
        meshes: Mapping[str, Meshes],
        settings: RobustSettings,
        law: Callable[[SkinSample], Loads] = Loads,
    ) -> None:
        super().__init__(smpl, sequences, meshes)
        self._settings, self._sample = settings, SkinSample(smpl, settings.vertices)
        self._loads = law(self._sample)

    def learn(self) -> dict[str, NDArray]:
        names = subjects_of(self.sequences)
        # On one machine all cores calibrate one subject; on a cluster each node another.
        with worker_pool(on_any_node("serial"), self) as pool:
            results = pool.map(RobustFit.calibrate, names)
            results = progress(results, what="subjects", unit="subject", total=len(names))
            columns = zip(*((betas, *tissue) for betas, tissue in results), strict=True)
            named = zip(_CALIBRATED, columns, strict=True)
            return {name: torch.stack(column).numpy() for name, column in named}

    def groups(self) -> list[list[Window]]:
        return [windows(sequence, _FRAMES_PER_WINDOW) for sequence in self.sequences]

    def fit(
        self,
        learned: Mapping[str, NDArray],
        groups: Sequence[Sequence[Window]],
        files: AlignedFiles,
    ) -> Generator[NDArray[np.float32], None, None]:
        """theta of each window; rotations continue those of the window before without jumps."""
        columns = (torch.from_numpy(learned[name]) for name in _CALIBRATED)
        rows = zip(subjects_of(self.sequences), *columns, strict=True)
        subjects = {name: (betas, Tissue(*tissue)) for name, betas, *tissue in rows}

        def fitted(fit: RobustFit, window: Window) -> tuple[Tensor, Tensor]:
            betas, tissue = subjects[window.sequence.subject]
            meshes, seen = fit._loads.observe(fit.meshes[window.sequence.name], window)
            pose, trans = fit.fit_frames(betas, tissue, seen)
            files.store(fit.smpl, window, betas, pose, trans, meshes)
            return pose, trans

        last = np.empty((0, N_JOINTS, 3), np.float32)
        all_windows = [window for group in groups for window in group]
        with torch_workers(on_any_node("threads"), self) as pool:
            poses = pool.map(fitted, all_windows)
            for window, (pose, trans) in zip(all_windows, poses, strict=True):
                before = last if window.start else last[:0]
                pose = continuous_rotations(np.concatenate([before, pose.numpy()]))[len(before) :]
                last = pose[-1:]
                yield pack_theta(pose, trans.numpy())

    def fit_frames(self, betas: Tensor, tissue: Tissue, seen: Observed) -> tuple[Tensor, Tensor]:
        """Pose (n, 22, 3) axis-angle and translation (n, 3) of frames of a subject."""
        shaped = self._sample.shaped(betas)
        poses = []
        for part in seen.split(_BATCH):
            pose, steps = initial_pose(shaped, part.vertices), self._settings.steps
            poses.append(self._fit_unloaded(shaped, tissue, part, pose, steps))
        rotations = torch.cat([pose.rotations for pose in poses])
        return matrix_to_axis_angle(rotations), torch.cat([pose.trans for pose in poses])

    def _fit_unloaded(
        self, shaped: Shaped, tissue: Tissue, seen: Observed, pose: Pose, steps: int
    ) -> Pose:
        """Poses fitted to the sample without the effect of loads, which is updated in each step."""
        weights = tissue.weights(self._loads.precision_m)
        for _ in range(steps):
            terms = self._loads.terms(seen, shaped.posed(pose).turn)
            target = tissue.unloaded(seen.vertices, terms)
            pose = fit_poses(shaped, target, weights, pose, 1)
        return pose

    def calibrate(self, subject: str) -> tuple[Tensor, Tissue]:
        """Estimate the betas (10,) and the softness of a subject from frames of all its sequences.

        In the first frame, to which the shape is fitted at first, soft tissue is displaced. So once
        the effect of loads is estimated, the shape is corrected by all frames without it.
        """
        sample, loads, precision_m = self._sample, self._loads, self._loads.precision_m
        sequences = [sequence for sequence in self.sequences if sequence.subject == subject]

        def start(_: RobustFit, seen: Observed) -> _Calibrated:
            pose = initial_pose(shaped, seen.vertices)
            weights = seen.vertices.new_ones(len(sample))
            pose = fit_poses(shaped, seen.vertices, weights, pose, _FIRST_STEPS)
            return _Calibrated(seen, pose)

        def evidence_of(_: RobustFit, batch: _Calibrated) -> Evidence:
            posed = shaped.posed(batch.pose)
            displacement = batch.seen.vertices - posed.positions()
            terms = loads.terms(batch.seen, posed.turn)
            return Evidence.of(displacement, terms, noise * loads.noise_in_common(terms))

        def refine(fit: RobustFit, batch: _Calibrated) -> Evidence:
            batch.pose = self._fit_unloaded(shaped, tissue, batch.seen, batch.pose, 1)
            return evidence_of(fit, batch)

        def equations_of_shape(_: RobustFit, batch: _Calibrated) -> tuple[Tensor, ...]:
            terms = loads.terms(batch.seen, shaped.posed(batch.pose).turn)
            target = tissue.unloaded(batch.seen.vertices, terms)
            weights = tissue.weights(precision_m)
            return shape_equations(shaped, batch.pose, target, weights)[:2]

        with torch_workers("threads", self) as pool:
            first = sample.select(torch.from_numpy(self.meshes[sequences[0].name].read(0, 1)))
            betas = fit_shape(sample, first, _SHAPE_STEPS)
            shaped = sample.shaped(betas)
            clips = [
                loads.observe(self.meshes[clip.sequence.name], clip)[1]
                for clip in evenly_spaced_clips(sequences, self._settings.calibration_frames)
            ]
            # The median over clips, as some hardly move and some move violently.
            variances_m2 = [noise_variance(clip.vertices, loads.around) for clip in clips]
            variance_m2 = float(np.median(variances_m2))
            noise = shared_noise(variance_m2, sequences[0].fps)
            seen = Observed(*(torch.cat(parts) for parts in zip(*clips, strict=True)))
            batches = list(pool.map(start, seen.split(_BATCH)))
            evidence = Evidence(*summed(pool.map(evidence_of, batches)))
            noise_m = np.sqrt(variance_m2) if variance_m2 > precision_m**2 else 0.0
            rigid = Tissue.rigid(evidence.pull.shape[1], sample.weights, noise_m)
            tissue = evidence.revise(rigid)
            for number in range(self._settings.calibration_rounds):
                tissue = Evidence(*summed(pool.map(refine, batches))).revise(tissue)
                if number % _ROUNDS_PER_SHAPE == _ROUNDS_PER_SHAPE - 1:
                    change = solve_damped(*summed(pool.map(equations_of_shape, batches)))
                    betas = betas + change.to(betas)
                    shaped = sample.shaped(betas)
        return betas, tissue


@dataclass
class _Calibrated:
    seen: Observed
    pose: Pose


def summed(parts: Iterable[tuple[Any, ...]]) -> list[Any]:
    """Sums over tuples, column by column."""
    return [reduce(add, column) for column in zip(*parts, strict=True)]


def evenly_spaced_clips(sequences: Sequence[MotionSequence], frames: int) -> Iterator[Window]:
    """Short clips at even distances over all frames of the sequences, `frames` in all."""
    ends = np.cumsum([sequence.length for sequence in sequences])
    count = max(min(frames, int(ends[-1])) // _CLIP, 1)
    for centre in (np.arange(count) + 0.5) * ends[-1] / count:
        row = int(np.searchsorted(ends, centre, side="right"))
        length = sequences[row].length
        within = int(centre) - int(ends[row] - length)
        start = min(max(within - _CLIP // 2, 0), max(length - _CLIP, 0))
        yield Window(sequences[row], start, min(start + _CLIP, length))
