"""The paper's aligner (Section 3.3): gradient descent with momentum on the mesh distance.

The distance is a norm that is not squared, so its gradient does not vanish near the optimum: with
the paper's learning rate the fit oscillates at about 2 mm (root mean square over vertices) from the
optimum, however long it runs. The method is kept as the paper has it. Of the iterates, the one with
the smallest distance is returned, which is Eq. 5's "best matching" theta*, or the last on request.

Each frame starts from the pose of the one before. So sequences are fitted side by side, in groups
that advance frame by frame as one batch.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from bridge.motion import MotionSequence, pack_theta, subject_rows, unpack_theta
from bridge.options import NonNegativeFloat, NonNegativeInt, PositiveFloat
from bridge.processes import usable_cores
from bridge.runs import ArtifactWriter
from bridge.runs.workers import WorkerPool, on_any_node, progress
from torch_align_ae.alignment import stock_sgd
from torch_align_ae.alignment.corpus_fit import AlignedFiles, CorpusFit, Meshes, Window, windows
from torch_align_ae.alignment.mesh_distance import MeshDistance, Shapes
from torch_align_ae.body import SMPL
from torch_align_ae.body.rotations import matrix_to_axis_angle, nearest_rotation
from torch_align_ae.workers import torch_workers

# Read, fitted and written between two checkpoints: two chunks of the corpus's files.
FRAMES_PER_WINDOW = 32
# Fewer bodies have too much overhead, many more do not fit into the cache (measured: 20-60).
_BODIES_AT_ONCE = 40
# A step of five bodies takes half as long as one of twenty, so idle cores get at least five.
_BODIES_AT_LEAST = 5
# With fewer steps, less than a minute of one core, starting processes takes too long.
_STEPS_WORTH_PROCESSES = 100_000


@dataclass(frozen=True, kw_only=True)
class Descent:
    """How to descend, and for how long."""

    steps: NonNegativeInt = 140
    """Steps for each frame after a sequence's first (the paper states no number). With 50, the fit
    loses jumps and fast limbs; more than 400 gain nothing (docs/alignment.md)."""
    first_frame_steps: NonNegativeInt = 2000
    """Steps for the pose of a sequence's first frame, once its subject's shape is fitted."""
    shape_steps: NonNegativeInt = 8000
    """Steps for a subject's shape, together with the pose of the subject's first frame."""
    lr: PositiveFloat = 1e-4
    """Learning rate (paper: 0.0001)."""
    momentum: NonNegativeFloat = 0.9
    """Momentum (paper: 0.9)."""
    iterate: Literal["closest", "last"] = "closest"
    """Which iterate is the fit: the paper's theta* is the "best matching" one."""
    betas_per: Literal["subject", "sequence"] = "subject"
    """Whether a subject's first sequence by name gives one shape for all, or the first frame of
    each sequence its own: the paper fixes the shape at "its first frame"."""
    stock: bool = False
    """Descend by `torch.optim.SGD` and autograd on the module `SMPL`: poses equal to a millionth,
    in several times the time."""


def fit_pose(
    shapes: Shapes, start: tuple[Tensor, ...], target: Tensor, steps: int, descent: Descent
) -> tuple[Tensor, ...]:
    """Fit pose (B, 22, 3) and translation (B, 3) of fixed shapes to meshes from `arrange`.

    `start` is the initial pose and translation.
    """
    if descent.stock:
        return stock_sgd.fit_pose(shapes, start, target, steps, descent)
    with torch.inference_mode():
        distance, optimizer = shapes.objective.to(target), MomentumDescent(descent, *start)
        for _ in range(steps):
            optimizer.step(*distance.gradient(shapes, *optimizer.variables))
    return optimizer.fitted()


def fit_shape_and_pose(
    objective: MeshDistance, target: Tensor, descent: Descent
) -> tuple[Tensor, ...]:
    """Fit betas (B, 10), pose (B, 22, 3) and translation (B, 3) to meshes from `arrange`."""
    if descent.stock:
        return stock_sgd.fit_shape_and_pose(objective, target, descent)
    with torch.inference_mode():
        distance = objective.to(target)
        betas = target.new_zeros(len(target), len(objective.smpl.shapedirs))
        start = rigid_start(objective.shapes(betas), target)
        optimizer = MomentumDescent(descent, betas, *start)
        for _ in progress(range(descent.shape_steps), what="shapes", unit="step"):
            betas, pose, trans = optimizer.variables
            distance_m, *by_pose = distance.gradient(objective.shapes(betas), pose, trans)
            optimizer.step(distance_m, distance.betas_gradient(), *by_pose)
    return optimizer.fitted()


class MomentumDescent:
    """Gradient descent with momentum on a batch of variables, like `torch.optim.SGD` but faster.

    For each body the iterate with the smallest distance is kept, the paper's theta*, or the last.
    """

    def __init__(self, descent: Descent, *start: Tensor) -> None:
        self.rate = descent.lr
        """Learning rate, which the paper keeps constant."""
        self._descent = descent
        self._shapes = [variable.shape[1:] for variable in start]
        self._state = torch.cat([variable.flatten(1) for variable in start], 1)
        self._velocity = torch.zeros_like(self._state)
        self._best = self._state.clone()
        self._smallest = self._state.new_full((len(self._state),), torch.inf)
        self.variables = self._parts(self._state)

    def step(self, distance: Tensor, *gradients: Tensor) -> None:
        """Take a step; distance (B,) and gradients are those at the present variables."""
        closer = distance < self._smallest
        self._best = torch.where(closer[:, None], self._state, self._best)
        self._smallest = torch.fmin(distance, self._smallest)
        gradient = torch.cat([gradient.flatten(1) for gradient in gradients], 1)
        self._velocity.mul_(self._descent.momentum).add_(gradient)
        self._state.sub_(self._velocity, alpha=self.rate)

    def fitted(self) -> tuple[Tensor, ...]:
        """The variables of each body where its distance was smallest, or the last ones."""
        chosen = self._state if self._descent.iterate == "last" else self._best
        return self._parts(chosen.clone())

    def _parts(self, state: Tensor) -> tuple[Tensor, ...]:
        parts = zip(state.split([s.numel() for s in self._shapes], 1), self._shapes, strict=True)
        return tuple(part.unflatten(1, shape) for part, shape in parts)


def rigid_start(shapes: Shapes, target: Tensor) -> tuple[Tensor, Tensor]:
    """Initial pose and translation of a first frame: the rest pose rigidly aligned to the meshes.

    The paper does not state its initial pose; without the rotation a person who faces the other way
    would not be found.
    """
    source, target = map(shapes.objective.restore, (shapes.vertices, target))
    centre, target_centre = source.mean(1), target.mean(1)
    turn = nearest_rotation((target - target_centre[:, None]).mT @ (source - centre[:, None]))
    root = shapes.joints[:, 0]
    # The root rotates about its joint: R (x - root) + root + trans.
    trans = target_centre - (turn @ (centre - root)[..., None])[..., 0] - root
    pose = torch.zeros_like(shapes.joints)
    pose[:, 0] = matrix_to_axis_angle(turn)
    return pose, trans


class SgdFit(CorpusFit):
    """Alignment of a corpus by the paper's method.

    Shapes are fitted to the first frame of each subject's first sequence, or of each sequence, then
    fixed (Section 3.3).
    """

    def __init__(
        self,
        smpl: SMPL,
        sequences: Sequence[MotionSequence],
        meshes: Mapping[str, Meshes],
        descent: Descent,
    ) -> None:
        super().__init__(smpl, sequences, meshes)
        self._objective, self._descent = MeshDistance(smpl), descent
        self._row_of = {sequence.name: row for row, sequence in enumerate(sequences)}
        rows = subject_rows(sequences)
        self._shape_of = [rows[sequence.subject] for sequence in sequences]
        """Row of each sequence in the betas."""
        if descent.betas_per == "sequence":
            self._shape_of = list(range(len(sequences)))
        self._pool: WorkerPool[MeshDistance]

    def write(self, writer: ArtifactWriter) -> None:
        """Write all arrays, with one pool of workers for all steps.

        A step has some hundred small operations, so workers are processes, or nodes of a cluster,
        unless there is little to do.
        """
        steps = self._descent.steps * sum(sequence.length for sequence in self.sequences)
        if steps < _STEPS_WORTH_PROCESSES:
            workers = torch_workers("serial", self._objective)
        else:
            n_workers = min(usable_cores(), len(batches(len(self.sequences))))
            workers = torch_workers(on_any_node("processes"), self._objective, n_workers)
        with workers as self._pool:
            super().write(writer)

    def learn(self) -> dict[str, NDArray]:
        """All shapes, and `theta` (N, 69) of every sequence's first frame."""
        meshes = np.concatenate([self.meshes[one.name].read(0, 1) for one in self.sequences])
        targets = self._objective.arrange(torch.from_numpy(meshes))
        leading = [self._shape_of.index(row) for row in range(max(self._shape_of) + 1)]
        # All shapes as one batch, not by workers, as small batches have too much overhead.
        shapes, *lead = fit_shape_and_pose(self._objective, targets[leading], self._descent)
        betas = shapes[self._shape_of]
        firsts = ((betas[rows], targets[rows]) for rows in batches(len(meshes)))
        fitted = self._pool.map(partial(_fit_first_frames, self._descent), firsts)
        pose, trans = (torch.cat(parts) for parts in zip(*fitted, strict=True))
        pose[leading], trans[leading] = lead
        return {"betas": shapes.numpy(), "theta": pack_theta(pose.numpy(), trans.numpy())}

    def groups(self) -> list[list[Window]]:
        """The windows with the same number of all sequences, the longest sequences first, so that
        those of similar length share a batch."""
        longest_first = sorted(self.sequences, key=lambda sequence: -sequence.length)
        parts = [windows(sequence, FRAMES_PER_WINDOW) for sequence in longest_first]
        groups = itertools.zip_longest(*parts)
        return [[window for window in group if window] for group in groups]

    def fit(
        self,
        learned: Mapping[str, NDArray],
        groups: Sequence[Sequence[Window]],
        files: AlignedFiles,
    ) -> Generator[NDArray[np.float32], None, None]:
        """theta of each window, which continues from the frame before it in the files."""

        def tracked(window: Window) -> _Tracked:
            row, first = self._row_of[window.sequence.name], window.rows.start
            theta = learned["theta"][row]
            if window.start:
                theta = files.theta.read(slice(first - 1, first))[0]
            betas = torch.from_numpy(learned["betas"][self._shape_of[row]])
            return _Tracked(window, self.meshes[window.sequence.name], betas, theta)

        work = partial(_fit_windows, self._descent, files)
        for group in groups:
            parts = ([tracked(group[row]) for row in rows] for rows in batches(len(group)))
            for thetas in self._pool.map(work, parts):
                yield from thetas


def _fit_first_frames(
    descent: Descent, objective: MeshDistance, item: tuple[Tensor, Tensor]
) -> tuple[Tensor, ...]:
    """Fit pose and translation to meshes (B, 3 V) with fixed betas (B, 10)."""
    betas, targets = item
    shapes = objective.shapes(betas)
    start = rigid_start(shapes, targets)
    return fit_pose(shapes, start, targets, descent.first_frame_steps, descent)


class _Tracked(NamedTuple):
    window: Window
    meshes: Meshes
    betas: Tensor  # (10,) shape of its subject
    theta: NDArray[np.float32]  # (69,) of the frame before the window's first, or of frame 0


def _fit_windows(
    descent: Descent, files: AlignedFiles, objective: MeshDistance, tracked: list[_Tracked]
) -> list[NDArray[np.float32]]:
    """theta of windows with the same first frame, longest first; other arrays go to the files.

    Each frame is fitted in all windows as one batch.
    """
    meshes = [torch.from_numpy(o.meshes.read(o.window.start, o.window.stop)) for o in tracked]
    before = unpack_theta(np.stack([one.theta for one in tracked]))
    pose, trans = (torch.from_numpy(part) for part in before)
    shapes = objective.shapes(torch.stack([one.betas for one in tracked]))
    fitted: list[list[list[Tensor]]] = [[] for _ in tracked]
    for frame in range(len(meshes[0])):
        # As they are sorted by length, the windows that have this frame are the first ones.
        count = sum(len(mesh) > frame for mesh in meshes)
        pose, trans = pose[:count], trans[:count]
        if tracked[0].window.start + frame > 0:
            target = objective.arrange(torch.stack([mesh[frame] for mesh in meshes[:count]]))
            some = shapes.rows(slice(count))
            pose, trans = fit_pose(some, (pose, trans), target, descent.steps, descent)
        for frames, *placed in zip(fitted, pose, trans, strict=False):
            frames.append(placed)
    thetas = []
    for one, mesh, frames in zip(tracked, meshes, fitted, strict=True):
        pose, trans = (torch.stack(parts) for parts in zip(*frames, strict=True))
        files.store(objective.smpl, one.window, one.betas, pose, trans, mesh)
        thetas.append(pack_theta(pose.numpy(), trans.numpy()))
    return thetas


def batches(count: int) -> list[list[int]]:
    """The rows 0 to `count` in batches of nearly equal size, enough for all cores.

    Many rows give an even number of batches, so that two cores finish together. The result of a row
    does not depend on the other rows of its batch, if these are three or more: products with fewer
    rows are computed in another order on some processors.
    """
    large = 2 * math.ceil(count / (2 * _BODIES_AT_ONCE))
    number = max(large, min(usable_cores(), count // _BODIES_AT_LEAST))
    return [rows.tolist() for rows in np.array_split(np.arange(count), max(min(count, number), 1))]
