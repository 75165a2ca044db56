"""`dsnet corpus`: the synthetic corpus in the formats of SMPL, Dyna and AMASS, and its truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import h5py
import numpy as np
from numpy.typing import NDArray
from tyro.conf import Fixed

from bridge.body import BodyModelData, load_body_model
from bridge.errors import DsnetError
from bridge.motion import MotionSequence, sequences_of, subject_rows, to_manifest
from bridge.motion.readers import find_motion_files
from bridge.options import NonNegativeInt, PositiveFloat, PositiveInt, Seed
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.runs.files import ArrayFile, arrays_sha256, is_written, mark_written
from bridge.runs.workers import on_any_node, progress, worker_pool
from torch_align_ae.corpus.corpus_motions import CorpusMotions
from torch_align_ae.corpus.dyna_files import FPS, write_dyna
from torch_align_ae.corpus.motions import DYNA_MOTIONS, HELD_OUT_MOTIONS
from torch_align_ae.corpus.recordings import (
    Crossing,
    Recording,
    dyna_recordings,
    held_out_recordings,
    real_recordings,
)
from torch_align_ae.corpus.simulation import posed_meshes
from torch_align_ae.corpus.subjects import SUBJECTS, UNSEEN, Gender, Subject
from torch_align_ae.corpus.tissue_laws import form_named, tissue_named

# For fewer, some ten seconds of one core, processes are not worth their start.
_FRAMES_WORTH_PROCESSES = 1500
_NOTICE = """\
Synthetic data. Bodies, motions and soft tissue are computed; no skin was measured.
The files have the formats of SMPL, Dyna and AMASS, but are none of these data sets.
The body derives from the MakeHuman assets (CC0).
"""
_REAL_NOTICE = """\
Exception: the motions of mosh/*_amass_* and mosh/*_bvh_* are real, and their makers' licence
governs them.
Bodies and soft tissue are computed there too. They are taken from: {files}
"""


@dataclass(frozen=True)
class CorpusConfig:
    """Make the synthetic corpus and, apart from it, the truth that only evaluation may read.

    Costs 165 kB of disk a frame for the truth and the meshes, half as much again in forms other
    than clean, and time for the soft tissue above all; what it took stands in the manifests and
    the report.
    """

    run: str = "demo"
    """Run to write into: runs/<run>/truth and runs/<run>/corpus."""
    seed: Seed = 0
    """Seed of every subject's style of moving."""
    gender: Gender = "female"
    """Whose bodies."""
    subjects: PositiveInt = 5
    """How many of the five subjects."""
    motions: tuple[str, ...] = tuple(DYNA_MOTIONS)
    """Dyna motions. All of them, of all subjects, make the paper's 67 sequences exactly."""
    mean_frames: PositiveInt = 321
    """Mean length of a sequence at 60 fps; the full corpus has the paper's total instead."""
    mosh_motions: tuple[str, ...] = tuple(HELD_OUT_MOTIONS)
    """Held-out kinds of motion that nobody is trained on."""
    mosh_seconds: PositiveFloat = 5.0
    """Length of each held-out motion; lying down and getting up takes its own time if longer."""
    retakes: Fixed[NonNegativeInt] = 3
    """How many of the motions, the last ones, known people do again and new people too."""
    crossing: Fixed[Crossing] = "full"
    """Who does each held-out kind: two known and three new people, or one of each in rotation."""
    amass: Path | None = None
    """Folder of AMASS files or BVHs: real motions as further test takes, with simulated tissue."""
    amass_seconds: PositiveFloat = 20.0
    """Longest part of a real motion that is used, from its beginning."""
    amass_fps: PositiveFloat | None = None
    """Frames per second of these files, where what they say of themselves is wrong."""
    amass_smooth_hz: PositiveFloat | Literal["auto"] | None = None
    """Leave out what is faster in these motions, where their recordings are noisy; `auto` finds the
    cutoff that suits each moment."""
    tissue: str = "own"
    """Law of the soft tissue: the product's own, or one of a module that DSNET_PLUGINS names."""
    form: str = "clean"
    """What the meshes have besides soft tissue: nothing, or a form of such a module."""
    gravity: Fixed[bool] = True
    """Whether turned limbs hang."""


PROFILES: dict[str, CorpusConfig] = {
    "smoke": CorpusConfig(
        subjects=2,
        motions=("one_leg_jump", "hips"),
        mean_frames=72,
        mosh_motions=("side_to_side_hopping",),
        mosh_seconds=1.2,
        retakes=1,
        crossing="rotating",
    ),
    "demo": CorpusConfig(
        motions=(
            "one_leg_jump",
            "hips",
            "light_hopping_loose",
            "jiggle_on_toes",
            "shake_arms",
            "shake_hips",
            "jumping_jacks",
            "running_on_spot",
        ),
        mean_frames=160,
        mosh_seconds=3.0,
        crossing="rotating",
    ),
    # 30 held-out motions, the paper's number of women's.
    "paper": CorpusConfig(retakes=4, crossing="rotating"),
}


@dataclass(frozen=True)
class CorpusPlan:
    """All recordings of a corpus: what is trained on and validated, and what is only predicted."""

    dyna: list[Recording]
    held_out: list[Recording]
    """Of procedural and real motions, one person after another, the known people first."""
    files: list[Path]  # where the real ones are from

    @property
    def all(self) -> list[Recording]:
        """Both, in the order in which they are stored."""
        return [*self.dyna, *self.held_out]


def plan_of(config: CorpusConfig) -> CorpusPlan:
    """The recordings that a configuration asks for; nothing is made yet."""
    if min(config.mean_frames, config.mosh_seconds * FPS) < 60:
        raise DsnetError(
            f"mean_frames={config.mean_frames}, mosh_seconds={config.mosh_seconds:g}",
            "at least 60 frames and 1 second",
            "Longer sequences, fewer motions or subjects.",
        )
    gender, subjects, motions = config.gender, config.subjects, config.motions
    dyna = dyna_recordings(gender, subjects, motions, config.mean_frames, config.seed)
    held_out = held_out_recordings(
        gender,
        subjects,
        unseen=config.mosh_motions,
        known=motions[max(0, len(motions) - config.retakes) :],
        seconds=config.mosh_seconds,
        crossing=config.crossing,
    )
    # Of bodies of any gender: no body of theirs is used.
    files = find_motion_files(config.amass, "any") if config.amass else []
    held_out += real_recordings(
        files, gender, subjects, config.amass_seconds, config.amass_fps, config.amass_smooth_hz
    )
    order = [subject.name for subject in (*SUBJECTS[gender], *UNSEEN[gender])]
    held_out.sort(key=lambda recording: order.index(recording.subject.name))
    return CorpusPlan(dyna, held_out, files)


def main(config: CorpusConfig) -> None:
    """Make `truth`, then `corpus` from it."""
    tissue_named(config.tissue)
    form_named(config.form)
    run, plan = Run(config.run), plan_of(config)
    files = {f"motion_{row}": path for row, path in enumerate(plan.files)}
    truth = run.build(
        "truth",
        config,
        lambda writer: _make_truth(writer, config, plan),
        data="synthetic",
        upstream=files,
    )
    run.build(
        "corpus",
        config,
        lambda writer: _make_corpus(writer, config, truth, plan),
        data="synthetic",
        upstream={"truth": truth, **files},
    )


def _make_truth(writer: ArtifactWriter, config: CorpusConfig, plan: CorpusPlan) -> None:
    """Move every subject and simulate its tissue; every finished sequence is a checkpoint."""
    body = load_body_model(f"embedded:{config.gender}")
    motions = CorpusMotions(body, config.gender, config.seed)
    thetas = {one.name: motions.for_meshes(one) for one in plan.dyna}
    thetas |= {one.name: motions.as_read_back(one) for one in plan.held_out}
    sequences, frames = [], 0
    for row, one in enumerate(plan.all):
        name, length = one.subject.name, len(thetas[one.name])
        split = "train" if row < len(plan.dyna) else "test"
        sequences.append(MotionSequence(one.name, name, one.motion, frames, length, FPS, split))
        frames += length
    writer.put("theta", np.concatenate(list(thetas.values())), "rad, last three m")
    subjects = list(dict.fromkeys(recording.subject for recording in plan.all))
    writer.put("betas", np.array([subject.betas for subject in subjects], np.float32), "1")
    shape = (frames, body.vertex_count, 3)
    offsets = writer.array_file("offsets", shape, np.float32, "m")
    if make_form := form_named(config.form):
        form = make_form(body, config.seed)
        static = writer.array_file("static", shape, np.float32, "m")
        for sequence in sequences:
            theta = thetas[sequence.name].astype(np.float64)
            static.write(sequence.start, form.static(sequence.subject, theta))
    writer.record(
        sequences=to_manifest(sequences),
        source="synthetic",
        gender=config.gender,
        tissue=config.tissue,
        form=config.form,
        gravity=config.gravity,
    )
    work = _TissueWork(config, sequences, thetas, offsets, writer.checkpoints.resolve())
    # A subject a core. Threads wait for Python's lock, which half of a step needs.
    kind = "threads" if frames < _FRAMES_WORTH_PROCESSES else "processes"
    with (
        progress(what="soft tissue", unit="frame", total=frames) as bar,
        worker_pool(on_any_node(kind), body) as pool,
    ):
        for done in pool.map(work.simulate, subjects):
            bar.update(done)


@dataclass(frozen=True, eq=False)
class _TissueWork:
    """What moving a subject's flesh needs, wherever it is done."""

    config: CorpusConfig
    sequences: list[MotionSequence]
    thetas: dict[str, NDArray[np.float32]]
    offsets: ArrayFile
    checkpoints: Path

    def simulate(self, body: BodyModelData, subject: Subject) -> int:
        """Write the offsets of all sequences of a subject that are not done; gives their frames."""
        own = [sequence for sequence in self.sequences if sequence.subject == subject.name]
        law = tissue_named(self.config.tissue)
        tissue = law(body, subject.betas, gravity=self.config.gravity)
        for sequence in own:
            done = self.checkpoints / f"{sequence.name}.done"
            if not is_written(done, lambda rows=sequence.frames: _digest(self.offsets.read(rows))):
                theta = self.thetas[sequence.name].astype(np.float64)
                offsets = tissue.offsets(theta, FPS)
                self.offsets.write(sequence.start, offsets)
                mark_written(done, _digest(offsets))
        return sum(sequence.length for sequence in own)


def _digest(offsets: NDArray[np.float32]) -> str:
    return arrays_sha256({"offsets": offsets})


def _make_corpus(
    writer: ArtifactWriter, config: CorpusConfig, truth: Artifact, plan: CorpusPlan
) -> None:
    """Write the files that a licensed user would have, and nothing of the truth."""
    body = load_body_model(f"embedded:{config.gender}")
    body.save_smpl_npz(writer.file_path(f"SMPL_{config.gender.upper()}.npz"))
    names = {one.kind: one.source.name for one in plan.held_out if one.source}
    notice = _NOTICE + (_REAL_NOTICE.format(files=", ".join(names.values())) if names else "")
    writer.file_path("NOTICE.txt").write_text(notice, encoding="utf-8")
    motions = CorpusMotions(body, config.gender, config.seed)
    for recording in plan.held_out:
        motions.write_amass(writer.file_path(f"mosh/{recording.name}_poses.npz"), recording)
    path = writer.file_path(f"dyna_{config.gender}.h5")
    _write_meshes(path, config, truth, body)
    sequences = [sequence for sequence in sequences_of(truth) if sequence.split != "test"]
    writer.record(
        sequences=to_manifest(sequences),
        source="synthetic",
        gender=config.gender,
        real_motions=names,
    )


def _write_meshes(path: Path, config: CorpusConfig, truth: Artifact, body: BodyModelData) -> None:
    make_form = form_named(config.form)
    form = make_form and make_form(body, config.seed)
    theta, offsets, betas = (truth.array(name) for name in ("theta", "offsets", "betas"))
    static = truth.array("static") if form else None
    rows = subject_rows(sequences_of(truth))
    dyna = [sequence for sequence in sequences_of(truth) if sequence.split != "test"]
    frames = sum(sequence.length for sequence in dyna)
    with (
        write_dyna(path, body.faces) as file,
        progress(what="meshes", unit="frame", total=frames) as bar,
    ):
        for sequence in dyna:
            own_betas = np.asarray(betas[rows[sequence.subject]], np.float64)
            own_theta = np.asarray(theta[sequence.frames], np.float64)
            own_offsets = offsets[sequence.frames]
            if static is not None:
                own_offsets = own_offsets + static[sequence.frames]
            meshes = posed_meshes(body, own_betas, own_theta, own_offsets)
            if form:
                meshes = form.registered(sequence.name, meshes, FPS)
            file.add(sequence.name, meshes)
            bar.update(sequence.length)
    with h5py.File(path, "r+") as file:
        file.attrs["source"] = "synthetic"
