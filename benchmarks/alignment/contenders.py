"""The aligners that are compared: each from recordings of one gender to shapes and poses.

Making a contender is preparation and is not timed: reading the body model, writing the input file
of the paper's aligner. Calling it does the whole alignment and may be repeated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks.alignment import peer_smplfitter
from benchmarks.alignment.in_memory import align_sequences
from benchmarks.alignment.known_sequences import KnownRecording
from benchmarks.alignment.lesser_laws import WeightsAlone
from bridge.body import BodyModelData
from bridge.meshes.dyna_files import dyna_sequences, write_dyna
from bridge.motion import MotionSequence, pack_theta
from bridge.paper import FPS
from bridge.runs import ArtifactWriter
from torch_align_ae.alignment.robust import RobustSettings
from torch_align_ae.alignment.sgd import Descent, SgdFit
from torch_align_ae.alignment.skin_sample import SkinSample
from torch_align_ae.alignment.tissue import Loads
from torch_align_ae.body import SMPL


@dataclass(frozen=True)
class Estimate:
    """What an aligner found of one sequence."""

    betas: NDArray[np.float32]
    """(10,), or (T, 10) when each frame has its own."""
    theta: NDArray[np.float32]
    """(T, 69)."""


Align = Callable[[], list[Estimate]]
Make = Callable[[BodyModelData, Sequence[KnownRecording]], Align]


def contenders(descent: Descent, folder: Path) -> dict[str, Make]:
    """All aligners by name; `descent` and `folder`, for its files, are those of the paper's."""

    def sgd(data: BodyModelData, recordings: Sequence[KnownRecording]) -> Align:
        return _PaperSgd(data, recordings, descent, folder)

    return {
        "sgd": sgd,
        "smplfitter_own_shape_3": _smplfitter_own_shape(3),
        "smplfitter_own_shape_10": _smplfitter_own_shape(10),
        "smplfitter_known_shape_3": _smplfitter_known_shape(3),
        "smplfitter_known_shape_10": _smplfitter_known_shape(10),
        "robust_fast": _robust(RobustSettings.fast()),
        "robust_without_inertia": _robust(RobustSettings(), WeightsAlone),
        "robust": _robust(RobustSettings()),
    }


TITLES = {
    "sgd": "the paper's SGD",
    "smplfitter_own_shape_3": "smplfitter, own shape each frame, 3 iterations",
    "smplfitter_own_shape_10": "smplfitter, own shape each frame, 10 iterations",
    "smplfitter_known_shape_3": "smplfitter, shape of frame 1, 3 iterations",
    "smplfitter_known_shape_10": "smplfitter, shape of frame 1, 10 iterations",
    "robust_fast": "ours, fast",
    "robust_without_inertia": "ours, weights only",
    "robust": "ours",
}


class _PaperSgd:
    """The project's own stage, from a Dyna file to an artifact: reading and writing them is in its
    time, and weighs little beside the steps of a frame."""

    def __init__(
        self,
        data: BodyModelData,
        recordings: Sequence[KnownRecording],
        descent: Descent,
        folder: Path,
    ) -> None:
        self._smpl, self._descent = SMPL(data), descent
        self._sequences = _index(recordings)
        self._meshes, self._artifact = folder / f"dyna_{data.gender}.h5", folder / data.gender
        with write_dyna(self._meshes, data.faces) as add:
            for recording in recordings:
                add(recording.name, recording.meshes_m)

    def __call__(self) -> list[Estimate]:
        writer = ArtifactWriter(self._artifact, "align", data="synthetic")
        meshes = {one.name: one for one in dyna_sequences([self._meshes])}
        SgdFit(self._smpl, self._sequences, meshes, self._descent).write(writer)
        betas, theta = (np.load(writer.file_path(f"{name}.npy")) for name in ("betas", "theta"))
        writer.discard()
        rows = _subject_rows([sequence.subject for sequence in self._sequences])
        return [
            Estimate(betas[row], theta[sequence.frames])
            for row, sequence in zip(rows, self._sequences, strict=True)
        ]


def _robust(settings: RobustSettings, law: Callable[[SkinSample], Loads] = Loads) -> Make:
    def make(data: BodyModelData, recordings: Sequence[KnownRecording]) -> Align:
        smpl = SMPL(data)
        subjects = _subject_rows([recording.subject for recording in recordings])
        meshes = [recording.meshes_m for recording in recordings]

        def align() -> list[Estimate]:
            betas, thetas = align_sequences(smpl, meshes, subjects, settings, law=law)
            return [
                Estimate(betas[row], theta) for row, theta in zip(subjects, thetas, strict=True)
            ]

        return align

    return make


def _smplfitter_known_shape(iterations: int) -> Make:
    """As the paper: a subject's shape from the first frame of its first sequence."""

    def make(data: BodyModelData, recordings: Sequence[KnownRecording]) -> Align:
        fitter, meshes = peer_smplfitter.body_fitter(data), _tensors(recordings)
        subjects = _subject_rows([recording.subject for recording in recordings])

        def align() -> list[Estimate]:
            leading = [subjects.index(row) for row in range(max(subjects) + 1)]
            shapes = [peer_smplfitter.first_frame_shape(fitter, meshes[i][0]) for i in leading]
            return [
                _estimate(*peer_smplfitter.fit_known_shape(fitter, shapes[row], mesh, iterations))
                for row, mesh in zip(subjects, meshes, strict=True)
            ]

        return align

    return make


def _smplfitter_own_shape(iterations: int) -> Make:
    def make(data: BodyModelData, recordings: Sequence[KnownRecording]) -> Align:
        fitter, meshes = peer_smplfitter.body_fitter(data), _tensors(recordings)

        def align() -> list[Estimate]:
            return [
                _estimate(*peer_smplfitter.fit_own_shape(fitter, mesh, iterations))
                for mesh in meshes
            ]

        return align

    return make


def _estimate(betas: torch.Tensor, pose: torch.Tensor, trans: torch.Tensor) -> Estimate:
    """The paper's theta has 22 joints: what was found for the hands is dropped."""
    return Estimate(betas.numpy(), pack_theta(pose.numpy(), trans.numpy()))


def _tensors(recordings: Sequence[KnownRecording]) -> list[torch.Tensor]:
    return [torch.from_numpy(recording.meshes_m) for recording in recordings]


def _subject_rows(subjects: Sequence[str]) -> list[int]:
    """Number of each sequence's subject, in order of first appearance."""
    rows = {subject: row for row, subject in enumerate(dict.fromkeys(subjects))}
    return [rows[subject] for subject in subjects]


def _index(recordings: Sequence[KnownRecording]) -> list[MotionSequence]:
    sequences, start = [], 0
    for one in recordings:
        length = len(one.meshes_m)
        motion = one.name.partition("_")[2]
        sequences.append(MotionSequence(one.name, one.subject, motion, start, length, FPS))
        start += length
    return sequences
