"""Aligning a whole corpus: first frames, then window by window, with a checkpoint after each."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from tqdm import tqdm

from bridge.errors import notify
from bridge.exchange.weights import load_checkpoint, save_checkpoint
from bridge.motion import MotionSequence, pack_theta, subject_rows, to_manifest, unpack_theta
from bridge.runs import ArtifactWriter
from bridge.runs.files import is_written, mark_written
from bridge.runs.workers import WorkerPool, on_any_node
from torch_align_ae.alignment.fitted import AlignedFiles, check_distances, seal
from torch_align_ae.alignment.paper.objective import MeshDistance
from torch_align_ae.alignment.paper.sgd import Descent, fit_pose, fit_shape_and_pose, rigid_start
from torch_align_ae.alignment.paper.tracking import FRAMES_PER_WINDOW, Track, follow, groups
from torch_align_ae.body import SMPL
from torch_align_ae.corpus.dyna_files import DynaReader
from torch_align_ae.workers import one_arithmetic_thread, torch_workers

# For fewer steps of a body, less than a minute of one core, processes are not worth their start.
_STEPS_WORTH_PROCESSES = 100_000


@dataclass(frozen=True)
class Effort:
    """Numbers of descent steps."""

    frame: int
    """For each frame after a sequence's first."""
    first_frame: int
    """For the pose of a sequence's first frame."""
    shape: int
    """For a subject's shape together with the pose of its very first frame."""


@dataclass
class _State:
    """Where the work has got to: what a checkpoint holds."""

    betas: NDArray[np.float32]
    """(S, 10) shapes of the subjects."""
    theta: NDArray[np.float32]
    """(N, 69) latest pose of each sequence."""
    next_frame: int
    """First frame, within each sequence, that is not yet written."""


@dataclass(frozen=True)
class _FirstFrames:
    """First frames of some sequences, their shapes being known."""

    betas: Tensor
    """(B, 10)."""
    targets: Tensor
    """(B, 3 V) from `MeshDistance.arrange`."""
    steps: int
    descent: Descent


def _fit_first_frames(objective: MeshDistance, first: _FirstFrames) -> tuple[Tensor, Tensor]:
    shapes = objective.shapes(first.betas)
    start = rigid_start(objective, shapes, first.targets)
    return fit_pose(objective, shapes, start, first.targets, first.steps, first.descent)


class CorpusFit:
    """One corpus to align; `write` fills the artifact.

    Shapes come from the first frame of each subject's first sequence and then stay (Section 3.3).
    """

    def __init__(
        self,
        smpl: SMPL,
        reader: DynaReader,
        sequences: list[MotionSequence],
        effort: Effort,
        descent: Descent,
    ) -> None:
        self._objective = MeshDistance(smpl)
        self._reader, self._sequences = reader, sequences
        self._effort, self._descent = effort, descent
        self._row_of_subject = subject_rows(sequences)
        self._subject_of = [self._row_of_subject[sequence.subject] for sequence in sequences]

    def write(self, writer: ArtifactWriter) -> None:
        """Write `betas`, `theta`, `offsets` and `frame_error`, or the part that is missing."""
        with self._workers() as pool:
            files = AlignedFiles.of(writer, self._sequences, self._objective.smpl.vertex_count)
            state = self._load(writer, files)
            if state is None:
                state = self._first_frames(pool)
                _save(writer, state)
            tracks = [self._track(index, state.betas) for index in range(len(self._sequences))]
            longest = max(sequence.length for sequence in self._sequences)
            with self._progress(state.next_frame) as progress:
                while state.next_frame < longest:
                    mark = _mark(writer, state.next_frame)
                    sealed = self._write_window(files, pool, tracks, state, progress)
                    mark_written(mark, sealed)
                    _save(writer, state)
        writer.put("betas", state.betas, "1")
        writer.record(sequences=to_manifest(self._sequences))

    def _workers(self) -> AbstractContextManager[WorkerPool[MeshDistance]]:
        """A step is some hundred small operations: processes, or nodes, unless there is little to
        do."""
        steps = self._effort.frame * sum(sequence.length for sequence in self._sequences)
        if steps < _STEPS_WORTH_PROCESSES:
            return torch_workers("serial", self._objective)
        n_workers = min(os.cpu_count() or 1, len(groups(len(self._sequences))))
        return torch_workers(on_any_node("processes"), self._objective, n_workers)

    def _first_frames(self, pool: WorkerPool[MeshDistance]) -> _State:
        """Shape of every subject, and pose of every sequence's first frame."""
        meshes = self._first_meshes()
        targets = self._objective.arrange(meshes)
        # Backwards, so that of a subject's sequences the first one stays.
        first = {row: track for track, row in reversed([*enumerate(self._subject_of)])}
        leading = [first[row] for row in self._row_of_subject.values()]
        betas, *lead = self._fit_shapes(targets[leading])
        pose, trans = self._fit_first_poses(pool, betas[self._subject_of], targets)
        pose[leading], trans[leading] = lead
        self._check_first_frames(betas[self._subject_of], pose, trans, meshes)
        return _State(betas.numpy(), pack_theta(pose.numpy(), trans.numpy()), 0)

    def _first_meshes(self) -> Tensor:
        """(N, V, 3) first frame of every sequence, metres."""
        meshes = np.empty((len(self._sequences), self._objective.smpl.vertex_count, 3), np.float32)
        for row, sequence in enumerate(self._sequences):
            meshes[row] = self._reader.frames(sequence.name, 0, 1)[0]
        return torch.from_numpy(meshes)

    def _fit_shapes(self, targets: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        steps = self._effort.shape
        # A step of few subjects takes its time between operations: one core does them all at once.
        with (
            one_arithmetic_thread(),
            tqdm(total=steps, desc="shapes", unit="step", disable=None) as progress,
        ):
            return fit_shape_and_pose(
                self._objective, targets, steps, self._descent, progress.update
            )

    def _fit_first_poses(
        self, pool: WorkerPool[MeshDistance], betas: Tensor, targets: Tensor
    ) -> list[Tensor]:
        firsts = (
            _FirstFrames(betas[rows], targets[rows], self._effort.first_frame, self._descent)
            for rows in groups(len(targets))
        )
        return _concatenate(pool.map(_fit_first_frames, firsts))

    def _check_first_frames(
        self, betas: Tensor, pose: Tensor, trans: Tensor, meshes: Tensor
    ) -> None:
        for row, sequence in enumerate(self._sequences):
            one = slice(row, row + 1)
            posed = self._objective.smpl(betas[one], pose[one], trans[one])[0]
            check_distances(sequence.name, 0, (posed - meshes[row]).norm(dim=1).mean()[None])

    def _track(self, index: int, betas: NDArray[np.float32]) -> Track:
        sequence = self._sequences[index]
        shape = torch.from_numpy(betas[self._subject_of[index]])
        return Track(sequence, self._reader.clip(sequence.name), shape)

    def _write_window(
        self,
        files: AlignedFiles,
        pool: WorkerPool[MeshDistance],
        tracks: list[Track],
        state: _State,
        progress: tqdm,
    ) -> str:
        """Fit one window of every sequence; gives its seal."""
        pose, trans = (torch.from_numpy(part.copy()) for part in unpack_theta(state.theta))
        start, steps, descent = state.next_frame, self._effort.frame, self._descent
        stored: dict[int, tuple[str, NDArray[np.float32]]] = {}
        for fitted in follow(pool, tracks, start, (pose, trans), steps, descent, files):
            theta = pack_theta(fitted.pose.numpy(), fitted.trans.numpy())
            files.theta.write(self._sequences[fitted.track].start + start, theta)
            stored[fitted.track] = fitted.digest, theta
            state.theta[fitted.track] = theta[-1]
            progress.update(len(theta))
        state.next_frame += FRAMES_PER_WINDOW
        return _sealed(stored)

    def _load(self, writer: ArtifactWriter, files: AlignedFiles) -> _State | None:
        """Where an earlier process got to, if all that it wrote until then is as it was."""
        stored = load_checkpoint(_state_file(writer))
        if stored is None:
            return None
        state = _State(stored["betas"], stored["theta"], int(stored["next_frame"][0]))
        for start in range(0, state.next_frame, FRAMES_PER_WINDOW):
            if not is_written(_mark(writer, start), partial(self._seal_of, files, start)):
                notify(f"{writer.path.name} was damaged while it was made; begun again")
                return None
        return state

    def _seal_of(self, files: AlignedFiles, start: int) -> str:
        """Of a window as the files hold it now."""
        stored = {}
        for track, sequence in enumerate(self._sequences):
            stop = min(start + FRAMES_PER_WINDOW, sequence.length)
            rows = slice(sequence.start + start, sequence.start + stop)
            if start < stop:
                stored[track] = files.digest(rows), files.theta.read(rows)
        return _sealed(stored)

    def _progress(self, done: int) -> tqdm:
        total = sum(sequence.length for sequence in self._sequences)
        initial = sum(min(sequence.length, done) for sequence in self._sequences)
        return tqdm(total=total, initial=initial, desc="align", unit="frame", disable=None)


def _concatenate(parts: Iterable[tuple[Tensor, ...]]) -> list[Tensor]:
    return [torch.cat(tensors) for tensors in zip(*parts, strict=True)]


def _sealed(stored: Mapping[int, tuple[str, NDArray[np.float32]]]) -> str:
    """The seal of what is stored of each sequence, whoever was done first."""
    digests, thetas = zip(*(stored[track] for track in sorted(stored)), strict=True)
    return seal(digests, thetas)


def _state_file(writer: ArtifactWriter) -> Path:
    return writer.checkpoints / "state.safetensors"


def _mark(writer: ArtifactWriter, start: int) -> Path:
    """The mark that the window from this frame on is written."""
    return writer.checkpoints / f"{start}.done"


def _save(writer: ArtifactWriter, state: _State) -> None:
    arrays = {
        "betas": state.betas,
        "theta": state.theta,
        "next_frame": np.array([state.next_frame]),
    }
    save_checkpoint(_state_file(writer), arrays)
