"""A run whose motions and offsets are smooth functions of time: for bookkeeping and memory only.

Nothing is simulated and there is nothing to learn. Every sequence is a part of one of two smooth
motions, so that sequences of any number are made as fast as they are written.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData, load_body_model
from bridge.body.posing import shaped_joints
from bridge.meshes.dyna_files import write_dyna
from bridge.motion import MotionSequence, to_manifest
from bridge.motion.sequences import Split, end_to_end, subjects_of
from bridge.motion.splits import take_suffix
from bridge.paper import FPS, N_JOINTS
from bridge.runs import ArtifactWriter, Run
from dsnet.synthetic.corpus_motions import write_amass_motion
from dsnet.synthetic.simulation import posed_meshes

NOTICE = "Smooth functions in place of motions and soft tissue: a corpus for benchmarks only.\n"
_GENDER = "female"
_FIRST_PERSON, _FIRST_STRANGER = 90_001, 95_001
_SHOULDERS = {16: -1.1, 17: 1.1}
_ROOT_HEIGHT_M = 0.9


@dataclass(frozen=True)
class SmoothBody:
    """One of the bodies, through one motion that is as long as the longest sequence."""

    betas: NDArray[np.float32]
    """(10,)."""
    theta: NDArray[np.float32]
    """(T, 69)."""
    offsets_m: NDArray[np.float32]
    """(T, V, 3)."""

    @classmethod
    def of(cls, data: BodyModelData, number: int, frames: int) -> SmoothBody:
        """Slow turns of all joints by some degrees, and waves of 4 mm along the body's height."""
        rng, times_s = np.random.default_rng(number), np.arange(frames)[:, None] / FPS
        theta = 0.05 * np.sin(rng.uniform(2, 12, 69) * times_s + rng.uniform(0, 6, 69))
        for joint, angle in _SHOULDERS.items():
            theta[:, 3 * joint + 2] += angle
        theta[:, 3 * N_JOINTS + 1] += _ROOT_HEIGHT_M
        waves = np.stack([np.cos(k * 4 * data.v_template[:, 1]) for k in range(1, 4)])
        beats = np.sin(rng.uniform(6, 36, 9) * times_s + rng.uniform(0, 6, 9))
        offsets_m = np.empty((frames, data.vertex_count, 3), np.float32)
        for frame, beat in enumerate(beats.reshape(-1, 3, 3)):
            offsets_m[frame] = 0.002 * np.einsum("kx,kv->vx", beat, waves)
        betas = rng.normal(0, 0.5, 10).astype(np.float32)
        return cls(betas, theta.astype(np.float32), offsets_m)


@dataclass(frozen=True)
class SmoothCorpus:
    """How many sequences, of whom, how long."""

    lengths: tuple[int, ...]
    """Frames of each sequence with meshes."""
    test_lengths: tuple[int, ...]
    """Frames of each motion that is only predicted; every other one is a new person's."""
    people: int
    """With meshes."""
    kinds: int = 20
    """Of motion."""

    @cached_property
    def aligned(self) -> list[MotionSequence]:
        """Sequences with meshes, in the order of a mesh file's keys; the last one is held out."""
        found = []
        for row, length in enumerate(self.lengths):
            subject = str(_FIRST_PERSON + row * self.people // len(self.lengths))
            found.append(self._sequence(subject, row, length))
        found.sort(key=lambda sequence: sequence.name)
        last = found.pop()
        return end_to_end([*found, MotionSequence(**{**vars(last), "split": "validation"})])

    @cached_property
    def sequences(self) -> list[MotionSequence]:
        """All of them, end to end."""
        tests = []
        for row, length in enumerate(self.test_lengths):
            first = _FIRST_STRANGER if row % 2 else _FIRST_PERSON
            subject = str(first + row * self.people // len(self.test_lengths))
            tests.append(self._sequence(subject, len(self.lengths) + row, length, "test"))
        return end_to_end([*self.aligned, *tests])

    @cached_property
    def _bodies(self) -> list[SmoothBody]:
        data = load_body_model(f"embedded:{_GENDER}")
        frames = max(*self.lengths, *self.test_lengths)
        return [SmoothBody.of(data, number, frames) for number in range(2)]

    def body_of(self, subject: str) -> SmoothBody:
        """Whose motion and shape a person has."""
        return self._bodies[int(subject) % len(self._bodies)]

    def write(self, run: Run, *, meshes: bool = True) -> None:
        """Write `truth` and `corpus`, the latter with a mesh file if there are to be `meshes`."""
        truth = ArtifactWriter(run.path / "truth", "truth", data="synthetic")
        self._put(truth, self.sequences)
        truth.record(source="synthetic", gender=_GENDER, notice=NOTICE)
        digest = truth.finish(config={"gender": _GENDER}).content_sha256
        data = load_body_model(f"embedded:{_GENDER}")
        corpus = ArtifactWriter(run.path / "corpus", "corpus", data="synthetic")
        data.save_smpl_npz(corpus.file_path(f"SMPL_{_GENDER.upper()}.npz"))
        corpus.file_path("NOTICE.txt").write_text(NOTICE, encoding="utf-8")
        for sequence in self.sequences[len(self.aligned) :]:
            self._write_motion(corpus, data, sequence)
        if meshes:
            self._write_meshes(corpus, data)
        corpus.record(sequences=to_manifest(self.aligned), source="synthetic", gender=_GENDER)
        corpus.finish(config={"gender": _GENDER}, upstream={"truth": digest})

    def _sequence(
        self, subject: str, row: int, length: int, split: Split = "train"
    ) -> MotionSequence:
        motion = f"kind{row % self.kinds:02d}{take_suffix(row)}"
        return MotionSequence(f"{subject}_{motion}", subject, motion, 0, length, FPS, split)

    def _part(self, sequence: MotionSequence) -> tuple[SmoothBody, slice]:
        """A body, and which frames of its motion a sequence is."""
        body = self.body_of(sequence.subject)
        start = 7 * sequence.start % (len(body.theta) - sequence.length + 1)
        return body, slice(start, start + sequence.length)

    def _put(self, writer: ArtifactWriter, sequences: list[MotionSequence]) -> None:
        frames = sum(sequence.length for sequence in sequences)
        vertices = self._bodies[0].offsets_m.shape[1]
        offsets = writer.array_file("offsets", (frames, vertices, 3), np.float32, "m")
        theta = np.empty((frames, self._bodies[0].theta.shape[1]), np.float32)
        for sequence in sequences:
            body, part = self._part(sequence)
            offsets.write(sequence.start, body.offsets_m[part])
            theta[sequence.frames] = body.theta[part]
        writer.put("theta", theta, "rad, last three m")
        betas = [self.body_of(subject).betas for subject in subjects_of(sequences)]
        writer.put("betas", np.stack(betas), "1")
        writer.record(sequences=to_manifest(sequences))

    def _write_motion(
        self, corpus: ArtifactWriter, data: BodyModelData, sequence: MotionSequence
    ) -> None:
        body, part = self._part(sequence)
        betas = np.asarray(body.betas, np.float64)
        write_amass_motion(
            corpus.file_path(f"mosh/{sequence.name}_poses.npz"),
            np.asarray(body.theta[part], np.float64),
            betas=betas,
            gender=_GENDER,
            fps=FPS,
            root_joint_m=shaped_joints(data, betas[None])[0, 0],
        )

    def _write_meshes(self, corpus: ArtifactWriter, data: BodyModelData) -> None:
        meshes = {
            id(body): posed_meshes(
                data,
                np.asarray(body.betas, np.float64),
                np.asarray(body.theta, np.float64),
                body.offsets_m,
            )
            for body in self._bodies
        }
        with write_dyna(corpus.file_path(f"dyna_{_GENDER}.h5"), data.faces) as add:
            for sequence in self.aligned:
                body, part = self._part(sequence)
                add(sequence.name, meshes[id(body)][part])


def short_lengths(count: int, least: int, most: int) -> Iterator[int]:
    """Frames of `count` short sequences, drawn evenly."""
    yield from np.random.default_rng(count).integers(least, most + 1, count).tolist()
