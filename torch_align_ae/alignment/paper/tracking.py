"""Following many sequences at once: each frame is started from the pose of the one before.

Sequences are cut into windows of frames, so that only a window of each is in memory; within a
window they are shared out in groups that advance frame by frame as one batch.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from bridge.motion import MotionSequence
from bridge.runs.workers import WorkerPool
from torch_align_ae.alignment.fitted import AlignedFiles, StoredFrames, measure
from torch_align_ae.alignment.paper.objective import MeshDistance
from torch_align_ae.alignment.paper.sgd import Descent, fit_pose
from torch_align_ae.corpus.dyna_files import MeshClip

# Read, fitted and written between two checkpoints: two chunks of the corpus's files.
FRAMES_PER_WINDOW = 32

# Fewer bodies waste time between operations, many more fall out of the cache (measured: 20-60).
_BODIES_PER_GROUP = 40


@dataclass(frozen=True)
class Track:
    """One sequence to follow."""

    sequence: MotionSequence
    meshes: MeshClip
    betas: Tensor
    """(10,) shape of its subject."""

    def window(self, start: int) -> Tensor:
        """(n, V, 3) meshes of a window, metres."""
        stop = min(start + FRAMES_PER_WINDOW, self.sequence.length)
        return torch.from_numpy(self.meshes.read(start, stop))


@dataclass(frozen=True)
class GroupWindow:
    """Consecutive frames of a group of sequences, and what their fit begins with."""

    rows: list[int]
    """Which sequences, longest first."""
    tracks: list[Track]
    """These sequences."""
    start: int
    """First frame, counted within each sequence."""
    pose: Tensor
    """(B, 22, 3) of the frame before the first, radians."""
    trans: Tensor
    """(B, 3) of the frame before the first, metres."""
    steps: int
    """For each frame."""
    descent: Descent
    """How to descend."""
    files: AlignedFiles
    """Where offsets and errors go."""


def follow(
    pool: WorkerPool[MeshDistance],
    tracks: list[Track],
    start: int,
    before: tuple[Tensor, Tensor],
    steps: int,
    descent: Descent,
    files: AlignedFiles,
) -> Iterator[StoredFrames]:
    """Fit one window of every sequence that is long enough, group by group.

    Parameters
    ----------
    pool : workers that fit the groups.
    tracks : all sequences.
    start : first frame of the window. Frame 0 is taken as fitted already.
    before : pose (N, 22, 3) and translation (N, 3) of frame `start - 1` of each sequence, or of
        frame 0 when `start` is 0.
    steps, descent : how to fit each frame.
    files : to which the workers write offsets and errors.

    Yields
    ------
    The window of each sequence, longest sequence first.
    """
    lengths = [track.sequence.length for track in tracks]
    active = [row for row, length in enumerate(lengths) if length > start]
    # Longest first, so that those that end together share a group.
    active.sort(key=lambda row: -lengths[row])

    def window(rows: list[int]) -> GroupWindow:
        group = [active[row] for row in rows]
        own = [tracks[row] for row in group]
        pose, trans = before[0][group], before[1][group]
        return GroupWindow(group, own, start, pose, trans, steps, descent, files)

    for fitted in pool.map(fit_window, map(window, groups(len(active)))):
        yield from fitted


def groups(count: int) -> list[list[int]]:
    """The rows 0 to `count` in groups of nearly equal size.

    An even number of them, so that two cores end together.
    """
    number = min(count, 2 * math.ceil(count / (2 * _BODIES_PER_GROUP)))
    return [group.tolist() for group in np.array_split(np.arange(count), max(number, 1))]


def fit_window(objective: MeshDistance, window: GroupWindow) -> list[StoredFrames]:
    """Fit frame after frame of all sequences of a window at once; read and write their files."""
    meshes = [track.window(window.start) for track in window.tracks]
    betas = torch.stack([track.betas for track in window.tracks])
    lengths = [len(mesh) for mesh in meshes]
    pose, trans = window.pose, window.trans
    poses = pose.new_zeros(len(pose), max(lengths), *pose.shape[1:])
    translations = trans.new_zeros(len(trans), max(lengths), 3)
    shapes = objective.shapes(betas)
    for frame in range(max(lengths)):
        # Sorted by length, so the sequences that go on are the first ones.
        going = sum(length > frame for length in lengths)
        pose, trans = pose[:going], trans[:going]
        if window.start + frame > 0:
            target = objective.arrange(torch.stack([mesh[frame] for mesh in meshes[:going]]))
            pose, trans = fit_pose(
                objective,
                shapes.rows(slice(going)),
                (pose, trans),
                target,
                window.steps,
                window.descent,
            )
        poses[:going, frame], translations[:going, frame] = pose, trans
    fitted = [
        measure(objective.smpl, row, window.start, *parts)
        for row, *parts in zip(window.rows, betas, poses, translations, meshes, strict=True)
    ]
    sequences = (track.sequence for track in window.tracks)
    return [window.files.store(*pair) for pair in zip(sequences, fitted, strict=True)]
