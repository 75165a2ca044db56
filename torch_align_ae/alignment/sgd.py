"""The paper's aligner (Section 3.3): gradient descent with momentum on the mesh distance.

The distance is a norm that is not squared, so its gradient does not fade near the optimum: with
the paper's rate the fit circles the optimum at about 2 mm (root mean square over vertices) and
comes no closer however long it runs. That is the method, and it is kept; of the iterates, the
one with the smallest distance is returned, which is Eq. 5's "best matching" theta*.

Each frame is started from the pose of the one before, so many sequences are followed at once: in
groups that advance frame by frame as one batch.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from bridge.motion import MotionSequence, pack_theta, subject_rows, unpack_theta
from bridge.options import NonNegativeFloat, NonNegativeInt, PositiveFloat
from bridge.processes import usable_cores
from bridge.runs import ArtifactWriter
from bridge.runs.workers import WorkerPool, on_any_node, progress
from torch_align_ae.alignment.corpus_fit import AlignedFiles, CorpusFit, Meshes, Window, windows
from torch_align_ae.alignment.mesh_distance import MeshDistance, Shapes
from torch_align_ae.body import SMPL
from torch_align_ae.body.rotations import matrix_to_axis_angle, nearest_rotation
from torch_align_ae.workers import torch_workers

# Read, fitted and written between two checkpoints: two chunks of the corpus's files.
FRAMES_PER_WINDOW = 32
# Fewer bodies waste time between operations, many more fall out of the cache (measured: 20-60).
_BODIES_AT_ONCE = 40
# A step of five takes half as long as one of twenty: for cores that would be idle, worth it.
_BODIES_AT_LEAST = 5
# For fewer steps of a body, less than a minute of one core, processes are not worth their start.
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


def fit_pose(
    shapes: Shapes, start: tuple[Tensor, ...], target: Tensor, steps: int, descent: Descent
) -> tuple[Tensor, ...]:
    """Pose (B, 22, 3) and translation (B, 3) that bring fixed shapes near meshes from `arrange`.

    `start` is the pose and translation to begin with.
    """
    with torch.inference_mode():
        distance, descending = shapes.objective.to(target), Descending(descent, *start)
        for _ in range(steps):
            descending.step(*distance.gradient(shapes, *descending.variables))
    return descending.best()


def fit_shape_and_pose(
    objective: MeshDistance, target: Tensor, descent: Descent
) -> tuple[Tensor, ...]:
    """betas (B, 10), pose (B, 22, 3) and translation (B, 3) of first frames from
    `MeshDistance.arrange`."""
    with torch.inference_mode():
        distance = objective.to(target)
        betas = target.new_zeros(len(target), len(objective.smpl.shapedirs))
        start = rigid_start(objective.shapes(betas), target)
        descending = Descending(descent, betas, *start)
        for _ in progress(range(descent.shape_steps), what="shapes", unit="step"):
            betas, pose, trans = descending.variables
            metres, *by_pose = distance.gradient(objective.shapes(betas), pose, trans)
            descending.step(metres, distance.betas_gradient(), *by_pose)
    return descending.best()


class Descending:
    """Gradient descent with momentum on a batch of variables: `torch.optim.SGD`, made lighter.

    Of each body's iterates the one with the smallest distance is kept, the paper's theta*.
    """

    def __init__(self, descent: Descent, *start: Tensor) -> None:
        self.rate = descent.lr
        """Learning rate: the paper's is the same at every step."""
        self._momentum = descent.momentum
        self._shapes = [variable.shape[1:] for variable in start]
        self._state = torch.cat([variable.flatten(1) for variable in start], 1)
        self._velocity = torch.zeros_like(self._state)
        self._best = self._state.clone()
        self._smallest = self._state.new_full((len(self._state),), torch.inf)
        self.variables = self._parts(self._state)

    def step(self, distance: Tensor, *gradients: Tensor) -> None:
        """Go on from where the distance (B,) and its gradients were taken."""
        closer = distance < self._smallest
        self._best = torch.where(closer[:, None], self._state, self._best)
        self._smallest = torch.fmin(distance, self._smallest)
        gradient = torch.cat([gradient.flatten(1) for gradient in gradients], 1)
        self._velocity.mul_(self._momentum).add_(gradient)
        self._state.sub_(self._velocity, alpha=self.rate)

    def best(self) -> tuple[Tensor, ...]:
        """The variables of each body where its distance was smallest."""
        return self._parts(self._best.clone())

    def _parts(self, state: Tensor) -> tuple[Tensor, ...]:
        parts = zip(state.split([s.numel() for s in self._shapes], 1), self._shapes, strict=True)
        return tuple(part.unflatten(1, shape) for part, shape in parts)


def rigid_start(shapes: Shapes, target: Tensor) -> tuple[Tensor, Tensor]:
    """Template pose turned and moved onto the meshes: where a first frame's descent begins.

    The paper does not say where its descent begins; from an unturned body it would not find a
    person who looks the other way.
    """
    source, target = map(shapes.objective.restore, (shapes.vertices, target))
    centre, target_centre = source.mean(1), target.mean(1)
    turn = nearest_rotation((target - target_centre[:, None]).mT @ (source - centre[:, None]))
    root = shapes.joints[:, 0]
    # The root turns about its own joint: R (x - root) + root + trans.
    trans = target_centre - (turn @ (centre - root)[..., None])[..., 0] - root
    pose = torch.zeros_like(shapes.joints)
    pose[:, 0] = matrix_to_axis_angle(turn)
    return pose, trans


class SgdFit(CorpusFit):
    """One corpus to align by the paper's method.

    Shapes come from the first frame of each subject's first sequence and then stay (Section 3.3).
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
        self._subject_of = [rows[sequence.subject] for sequence in sequences]
        self._pool: WorkerPool[MeshDistance]

    def write(self, writer: ArtifactWriter) -> None:
        """As every aligner; all that workers do is done by the same ones.

        A step is some hundred small operations: processes, or nodes, unless there is little to do.
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
        """Shape of every subject, and `theta` (N, 69) of every sequence's first frame."""
        meshes = np.concatenate([self.meshes[one.name].read(0, 1) for one in self.sequences])
        targets = self._objective.arrange(torch.from_numpy(meshes))
        leading = [self._subject_of.index(row) for row in range(max(self._subject_of) + 1)]
        # All subjects at once, not by the workers: a step of few takes its time between operations.
        shapes, *lead = fit_shape_and_pose(self._objective, targets[leading], self._descent)
        betas = shapes[self._subject_of]
        firsts = ((betas[rows], targets[rows]) for rows in batches(len(meshes)))
        found = self._pool.map(partial(_fit_first_frames, self._descent), firsts)
        pose, trans = (torch.cat(parts) for parts in zip(*found, strict=True))
        pose[leading], trans[leading] = lead
        return {"betas": shapes.numpy(), "theta": pack_theta(pose.numpy(), trans.numpy())}

    def groups(self) -> list[list[Window]]:
        """The same window of all sequences; longest first, so that those that end together share
        a batch."""
        longest_first = sorted(self.sequences, key=lambda sequence: -sequence.length)
        parts = [windows(sequence, FRAMES_PER_WINDOW) for sequence in longest_first]
        alike = itertools.zip_longest(*parts)
        return [[window for window in group if window] for group in alike]

    def fit(
        self,
        learned: Mapping[str, NDArray],
        groups: Sequence[Sequence[Window]],
        files: AlignedFiles,
    ) -> Generator[NDArray[np.float32], None, None]:
        """theta of each window; each goes on from the frame before, which is in the files."""

        def tracked(window: Window) -> _Tracked:
            row, first = self._row_of[window.sequence.name], window.rows.start
            theta = learned["theta"][row]
            if window.start:
                theta = files.theta.read(slice(first - 1, first))[0]
            betas = torch.from_numpy(learned["betas"][self._subject_of[row]])
            return _Tracked(window, self.meshes[window.sequence.name], betas, theta)

        work = partial(_fit_windows, self._descent, files)
        for group in groups:
            parts = ([tracked(group[row]) for row in rows] for rows in batches(len(group)))
            for thetas in self._pool.map(work, parts):
                yield from thetas


def _fit_first_frames(
    descent: Descent, objective: MeshDistance, item: tuple[Tensor, Tensor]
) -> tuple[Tensor, ...]:
    """Pose and translation of meshes (B, 3 V), their shapes (B, 10) being known."""
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
    """theta of windows that begin alike, longest first, fitted frame after frame of all at once;
    the rest goes to the files."""
    meshes = [torch.from_numpy(o.meshes.read(o.window.start, o.window.stop)) for o in tracked]
    before = unpack_theta(np.stack([one.theta for one in tracked]))
    pose, trans = (torch.from_numpy(part) for part in before)
    shapes = objective.shapes(torch.stack([one.betas for one in tracked]))
    found: list[list[list[Tensor]]] = [[] for _ in tracked]
    for frame in range(len(meshes[0])):
        # Sorted by length, so the sequences that go on are the first ones.
        going = sum(len(mesh) > frame for mesh in meshes)
        pose, trans = pose[:going], trans[:going]
        if tracked[0].window.start + frame > 0:
            target = objective.arrange(torch.stack([mesh[frame] for mesh in meshes[:going]]))
            own = shapes.rows(slice(going))
            pose, trans = fit_pose(own, (pose, trans), target, descent.steps, descent)
        for frames, *placed in zip(found, pose, trans, strict=False):
            frames.append(placed)
    thetas = []
    for one, mesh, frames in zip(tracked, meshes, found, strict=True):
        pose, trans = (torch.stack(parts) for parts in zip(*frames, strict=True))
        files.store(objective.smpl, one.window, one.betas, pose, trans, mesh)
        thetas.append(pack_theta(pose.numpy(), trans.numpy()))
    return thetas


def batches(count: int) -> list[list[int]]:
    """The rows 0 to `count` in batches of nearly equal size: enough of them for all cores.

    An even number where there are many rows, so that two cores end together. What is found of a
    row does not depend on the others of its batch, if these are three or more: products with fewer
    rows are made in another order on some processors.
    """
    large = 2 * math.ceil(count / (2 * _BODIES_AT_ONCE))
    number = max(large, min(usable_cores(), count // _BODIES_AT_LEAST))
    return [rows.tolist() for rows in np.array_split(np.arange(count), max(min(count, number), 1))]
