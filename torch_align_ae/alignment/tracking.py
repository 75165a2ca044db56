"""Following many sequences at once: each frame is started from the pose of the one before.

Sequences are cut into windows of frames, so that only a window of each is in memory; within a
window they are shared out in groups that advance frame by frame as one batch.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torch_align_ae.alignment.fitted import Fitted, measure
from torch_align_ae.alignment.objective import MeshDistance
from torch_align_ae.alignment.sgd import Descent, fit_pose
from torch_align_ae.alignment.threads import workers

# Read, fitted and written between two checkpoints: two chunks of the corpus's files.
FRAMES_PER_WINDOW = 32

# Fewer bodies waste time between operations, many more fall out of the cache (measured: 20-60).
_BODIES_PER_GROUP = 40

_Result = TypeVar("_Result")


@dataclass(frozen=True)
class Track:
    """One sequence to follow."""

    read: Callable[[int, int], NDArray[np.float32]]
    """Frames [start, stop) as (n, V, 3) metres."""
    length: int
    """Number of frames."""
    betas: Tensor
    """(10,) shape of its subject."""


def follow(
    objective: MeshDistance,
    tracks: list[Track],
    start: int,
    before: tuple[Tensor, Tensor],
    steps: int,
    descent: Descent,
) -> Iterator[Fitted]:
    """Fit one window of every sequence that is long enough, group by group.

    Parameters
    ----------
    tracks : all sequences.
    start : first frame of the window. Frame 0 is taken as fitted already.
    before : pose (N, 22, 3) and translation (N, 3) of frame `start - 1` of each sequence, or of
        frame 0 when `start` is 0.
    steps, descent : how to fit each frame.

    Yields
    ------
    The window of each sequence, longest sequence first.
    """
    active = [index for index, track in enumerate(tracks) if track.length > start]
    # Longest first, so that those that end together share a group.
    active.sort(key=lambda index: -tracks[index].length)

    def work(rows: list[int]) -> list[Fitted]:
        group = [active[row] for row in rows]
        return _follow_group(objective, tracks, start, before, steps, descent, group)

    for results in in_groups(len(active), work):
        yield from results


def in_groups(count: int, work: Callable[[list[int]], _Result]) -> Iterator[_Result]:
    """Results of `work` on groups of the rows 0 to `count`, in order, computed in threads."""
    with workers() as pool:
        yield from pool.map(work, _groups(count))


def _groups(count: int) -> list[list[int]]:
    """Groups of nearly equal size, an even number of them so that two cores end together."""
    number = min(count, 2 * math.ceil(count / (2 * _BODIES_PER_GROUP)))
    return [group.tolist() for group in np.array_split(np.arange(count), max(number, 1))]


def _follow_group(
    objective: MeshDistance,
    tracks: list[Track],
    start: int,
    before: tuple[Tensor, Tensor],
    steps: int,
    descent: Descent,
    group: list[int],
) -> list[Fitted]:
    lengths = [min(FRAMES_PER_WINDOW, tracks[index].length - start) for index in group]
    meshes = [
        torch.from_numpy(tracks[index].read(start, start + length))
        for index, length in zip(group, lengths, strict=True)
    ]
    betas = torch.stack([tracks[index].betas for index in group])
    poses = before[0].new_zeros(len(group), max(lengths), *before[0].shape[1:])
    translations = before[1].new_zeros(len(group), max(lengths), 3)
    pose, trans = before[0][group], before[1][group]
    shapes = objective.shapes(betas)
    for frame in range(max(lengths)):
        # Sorted by length, so the sequences that go on are the first ones.
        going = sum(length > frame for length in lengths)
        pose, trans = pose[:going], trans[:going]
        if start + frame > 0:
            target = objective.arrange(torch.stack([mesh[frame] for mesh in meshes[:going]]))
            pose, trans = fit_pose(
                objective,
                shapes.rows(slice(going)),
                (pose, trans),
                target,
                steps,
                descent,
            )
        poses[:going, frame], translations[:going, frame] = pose, trans
    return [
        measure(objective.smpl, index, start, betas[row], poses[row], translations[row], mesh)
        for row, (index, mesh) in enumerate(zip(group, meshes, strict=True))
    ]
