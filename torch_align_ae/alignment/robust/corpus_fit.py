"""A whole corpus through the robust aligner: subjects first, then window by window."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import groupby
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from tqdm import tqdm

from bridge.exchange.weights import load_checkpoint, save_checkpoint
from bridge.motion import MotionSequence, subject_rows, to_manifest
from bridge.runs import ArtifactWriter
from bridge.runs.files import is_written, mark_written
from bridge.runs.workers import on_any_node, worker_pool
from torch_align_ae.alignment.fitted import AlignedFiles, StoredFrames, measure, seal
from torch_align_ae.alignment.robust.align import FRAMES_PER_WINDOW, continued_theta, fit_frames
from torch_align_ae.alignment.robust.calibration import LearnedSubject, calibrate
from torch_align_ae.alignment.robust.loads import Loads
from torch_align_ae.alignment.robust.recording import FrameWindow, MeshRecording, windows
from torch_align_ae.alignment.robust.sample import SkinSample
from torch_align_ae.alignment.robust.settings import RobustSettings
from torch_align_ae.alignment.robust.tissue import Tissue
from torch_align_ae.body import SMPL
from torch_align_ae.corpus.dyna_files import DynaReader
from torch_align_ae.workers import torch_workers

_LEARNED = {"betas": "1", "compliance": "s^2", "deviation": "m", "noise": "m"}


class RobustCorpusFit:
    """One corpus to align; `write` fills the artifact.

    Besides what every aligner gives, the artifact holds what was learned of each subject's
    tissue: `compliance` (S, K, N) and `deviation` (S, N) at `sample_vertices` (N,) of the mesh, and
    the meshes' `noise` (S,).
    """

    def __init__(
        self,
        smpl: SMPL,
        reader: DynaReader,
        sequences: list[MotionSequence],
        settings: RobustSettings,
    ) -> None:
        self._smpl, self._settings, self._sequences = smpl, settings, sequences
        self._sample = SkinSample(smpl, settings.vertices)
        self._loads = Loads.of(self._sample)
        self._recordings = [
            MeshRecording(reader.clip(sequence.name).read, sequence.length, sequence.fps)
            for sequence in sequences
        ]
        self._row_of_subject = subject_rows(sequences)

    def write(self, writer: ArtifactWriter) -> None:
        """Write all arrays, or the part that is missing; sequences are checkpoints."""
        learned = self._learned(writer)
        files = AlignedFiles.of(writer, self._sequences, self._smpl.vertex_count)
        done = self._done(writer, files)
        with (
            torch_workers(on_any_node("threads"), self._sample) as pool,
            self._progress(done) as bar,
        ):
            fitted = pool.map(self._window_fit(_subjects(learned), files), self._open(done))
            for row, windows_of_one in groupby(fitted, lambda window: window.track):
                mark_written(_mark(writer, row), self._store(files, windows_of_one, bar))
        for name, unit in _LEARNED.items():
            writer.put(name, learned[name], unit)
        writer.put("sample_vertices", self._sample.vertices.numpy(), "index")
        writer.record(sequences=to_manifest(self._sequences))

    def _learned(self, writer: ArtifactWriter) -> dict[str, NDArray]:
        """`betas`, `compliance` and `deviation` of all subjects, learned unless they were."""
        path = writer.checkpoints / "subjects.safetensors"
        learned = load_checkpoint(path)
        if learned is None:
            # Here all cores work on one person; on a cluster each node has people of its own.
            with worker_pool(on_any_node("serial"), self._sample) as pool:
                found = pool.map(self._learn, self._row_of_subject)
                names = len(self._row_of_subject)
                bar = tqdm(found, total=names, desc="subjects", unit="subject", disable=None)
                learned = _stacked(list(bar))
            save_checkpoint(path, learned)
        return learned

    def _learn(self, sample: SkinSample, name: str) -> LearnedSubject:
        pairs = zip(self._recordings, self._sequences, strict=True)
        own = [recording for recording, sequence in pairs if sequence.subject == name]
        with torch_workers("threads", sample) as pool:
            return calibrate(sample, self._loads, own, self._settings, pool)

    def _open(self, done: set[int]) -> list[FrameWindow]:
        """All windows of the sequences that are not done, in order."""
        lengths = [recording.length for recording in self._recordings]
        return [w for w in windows(lengths, FRAMES_PER_WINDOW) if w.row not in done]

    def _window_fit(
        self, subjects: list[LearnedSubject], files: AlignedFiles
    ) -> Callable[[SkinSample, FrameWindow], StoredFrames]:
        """The work that fits a window and writes its offsets."""

        def fit(sample: SkinSample, window: FrameWindow) -> StoredFrames:
            sequence = self._sequences[window.row]
            subject = subjects[self._row_of_subject[sequence.subject]]
            recording = self._recordings[window.row]
            meshes, seen = self._loads.observe(recording, window.start, window.stop)
            pose, trans = fit_frames(sample, self._loads, subject, seen, self._settings)
            fitted = measure(
                self._smpl, window.row, window.start, subject.betas, pose, trans, meshes
            )
            return files.store(sequence, fitted)

        return fit

    def _store(self, files: AlignedFiles, sequence: Iterator[StoredFrames], bar: tqdm) -> str:
        """Poses of a sequence's windows, each going on from the one before; gives its seal."""
        digests, thetas = [], []
        for stored in sequence:
            before = thetas[-1][-1] if thetas else None
            thetas.append(continued_theta(stored.pose, stored.trans, before))
            digests.append(stored.digest)
            files.theta.write(self._sequences[stored.track].start + stored.start, thetas[-1])
            bar.update(len(thetas[-1]))
        return seal(digests, [np.concatenate(thetas)])

    def _done(self, writer: ArtifactWriter, files: AlignedFiles) -> set[int]:
        """The sequences of which the files hold what an earlier process wrote."""
        return {
            row
            for row, sequence in enumerate(self._sequences)
            if is_written(_mark(writer, row), partial(_seal_of, files, sequence))
        }

    def _progress(self, done: set[int]) -> tqdm:
        lengths = [recording.length for recording in self._recordings]
        there = sum(lengths[row] for row in done)
        return tqdm(total=sum(lengths), initial=there, desc="align", unit="frame", disable=None)


def _stacked(subjects: list[LearnedSubject]) -> dict[str, NDArray[np.float32]]:
    columns = zip(*((s.betas, *s.tissue) for s in subjects), strict=True)
    return {
        name: torch.stack(column).numpy() for name, column in zip(_LEARNED, columns, strict=True)
    }


def _subjects(learned: Mapping[str, NDArray[np.float32]]) -> list[LearnedSubject]:
    rows = zip(*(torch.from_numpy(learned[name]) for name in _LEARNED), strict=True)
    return [LearnedSubject(betas, Tissue(*tissue)) for betas, *tissue in rows]


def _seal_of(files: AlignedFiles, sequence: MotionSequence) -> str:
    """Of a sequence as the files hold it now."""
    digests = [
        files.digest(slice(sequence.start + window.start, sequence.start + window.stop))
        for window in windows([sequence.length], FRAMES_PER_WINDOW)
    ]
    return seal(digests, [files.theta.read(sequence.frames)])


def _mark(writer: ArtifactWriter, row: int) -> Path:
    """The mark that a sequence is written."""
    return writer.checkpoints / f"{row}.done"
