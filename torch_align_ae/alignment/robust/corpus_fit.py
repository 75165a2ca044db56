"""A whole corpus through the robust aligner: subjects first, then window by window."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import groupby
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from tqdm import tqdm

from bridge.exchange.checkpoints import load_checkpoint, save_checkpoint
from bridge.motion import MotionSequence, subject_rows, to_manifest, unpack_theta
from bridge.runs import ArtifactWriter
from bridge.runs.storage import is_written, mark_written
from bridge.runs.worker_pool import WorkerPool
from torch_align_ae.alignment.fitted import AlignedArrays, Fitted, measure
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
        self._loads = Loads.of(self._sample, settings)
        self._recordings = [_recording(reader, sequence) for sequence in sequences]
        self._row_of_subject = subject_rows(sequences)

    def write(self, writer: ArtifactWriter) -> None:
        """Write all arrays, or the part that is missing; sequences are checkpoints."""
        with torch_workers("threads", self._sample) as pool:
            learned = self._learned(writer, pool)
            done = [row for row in range(len(self._sequences)) if self._is_done(writer, row)]
            fitted = self._fit(done, _subjects(learned), pool)
            with self._progress(done) as bar:
                for row, windows_of_one in groupby(fitted, lambda window: window.track):
                    self._store(writer, row, windows_of_one, bar)
        self._open_arrays(writer)
        for name, unit in _LEARNED.items():
            writer.put(name, learned[name], unit)
        writer.put("sample_vertices", self._sample.vertices.numpy(), "index")
        writer.record(sequences=to_manifest(self._sequences))

    def _learned(self, writer: ArtifactWriter, pool: WorkerPool[SkinSample]) -> dict[str, NDArray]:
        """`betas`, `compliance` and `deviation` of all subjects, learned unless they were."""
        path = writer.checkpoints / "subjects.safetensors"
        learned = load_checkpoint(path)
        if learned is None:
            names = tqdm(self._row_of_subject, desc="subjects", unit="subject", disable=None)
            learned = _stacked([self._learn(name, pool) for name in names])
            save_checkpoint(path, learned)
        return learned

    def _learn(self, name: str, pool: WorkerPool[SkinSample]) -> LearnedSubject:
        pairs = zip(self._recordings, self._sequences, strict=True)
        own = [recording for recording, sequence in pairs if sequence.subject == name]
        return calibrate(self._sample, self._loads, own, self._settings, pool)

    def _fit(
        self, done: list[int], subjects: list[LearnedSubject], pool: WorkerPool[SkinSample]
    ) -> Iterator[Fitted]:
        """All windows of the sequences that are not done, in order."""

        def fit(sample: SkinSample, window: FrameWindow) -> Fitted:
            row = self._row_of_subject[self._sequences[window.row].subject]
            recording = self._recordings[window.row]
            meshes, seen = self._loads.observe(recording, window.start, window.stop)
            pose, trans = fit_frames(sample, self._loads, subjects[row], seen, self._settings)
            betas = subjects[row].betas
            return measure(self._smpl, window.row, window.start, betas, pose, trans, meshes)

        lengths = [recording.length for recording in self._recordings]
        open_windows = [
            window for window in windows(lengths, FRAMES_PER_WINDOW) if window.row not in done
        ]
        return pool.map(fit, open_windows)

    def _store(
        self, writer: ArtifactWriter, row: int, sequence: Iterator[Fitted], bar: tqdm
    ) -> None:
        # Opened anew for each sequence: pages of a map count as memory until it is closed.
        arrays, before = self._open_arrays(writer), None
        for fitted in sequence:
            theta = continued_theta(fitted.pose, fitted.trans, before)
            pose = torch.from_numpy(unpack_theta(theta)[0].copy())
            before = arrays.write(replace(fitted, pose=pose))
            bar.update(len(pose))
        arrays.flush()
        mark_written(_mark(writer, row), *arrays.rows(self._sequences[row].frames))

    def _is_done(self, writer: ArtifactWriter, row: int) -> bool:
        rows = self._open_arrays(writer).rows(self._sequences[row].frames)
        return is_written(_mark(writer, row), *rows)

    def _open_arrays(self, writer: ArtifactWriter) -> AlignedArrays:
        return AlignedArrays(writer, self._sequences, self._smpl.vertex_count)

    def _progress(self, done: list[int]) -> tqdm:
        lengths = [recording.length for recording in self._recordings]
        there = sum(lengths[row] for row in done)
        return tqdm(total=sum(lengths), initial=there, desc="align", unit="frame", disable=None)


def _recording(reader: DynaReader, sequence: MotionSequence) -> MeshRecording:
    def read(start: int, stop: int) -> NDArray[np.float32]:
        return reader.frames(sequence.name, start, stop)

    return MeshRecording(read, sequence.length, sequence.fps)


def _stacked(subjects: list[LearnedSubject]) -> dict[str, NDArray[np.float32]]:
    columns = zip(*((s.betas, *s.tissue) for s in subjects), strict=True)
    return {
        name: torch.stack(column).numpy() for name, column in zip(_LEARNED, columns, strict=True)
    }


def _subjects(learned: Mapping[str, NDArray[np.float32]]) -> list[LearnedSubject]:
    rows = zip(*(torch.from_numpy(learned[name]) for name in _LEARNED), strict=True)
    return [LearnedSubject(betas, Tissue(*tissue)) for betas, *tissue in rows]


def _mark(writer: ArtifactWriter, row: int) -> Path:
    """The mark that a sequence is written."""
    return writer.checkpoints / f"{row}.done"
