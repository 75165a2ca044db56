"""`dsnet corpus`: make a synthetic corpus in the formats of SMPL, Dyna and AMASS, and its truth."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData, load_body_model
from bridge.meshes.dyna_files import write_dyna
from bridge.motion import MotionSequence, sequences_of, subject_rows, to_manifest
from bridge.paper import FPS
from bridge.processes import usable_cores
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.runs.files import ArrayFile, arrays_sha256, is_written, mark_written
from bridge.runs.workers import on_any_node, progress, worker_pool
from dsnet.synthetic.corpus_motions import CorpusMotions
from dsnet.synthetic.recordings import CorpusConfig, CorpusPlan, plan_of
from dsnet.synthetic.simulation import posed_meshes
from dsnet.synthetic.subjects import Subject
from dsnet.synthetic.tissue_laws import form_named, tissue_named

# With fewer frames, about ten seconds of one core, starting processes takes too long.
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
        # Long enough that the paper's blocks of 300 frames are a tenth padding.
        motions=(
            "one_leg_jump",
            "jiggle_on_toes",
            "shake_hips",
            "jumping_jacks",
            "running_on_spot",
        ),
        mean_frames=270,
        mosh_seconds=3.0,
        crossing="rotating",
    ),
    # 30 held-out motions, the paper's number of women's.
    "paper": CorpusConfig(retakes=4, crossing="rotating"),
}


def main(config: CorpusConfig) -> None:
    """Make `truth`, then `corpus` from it."""
    tissue_named(config.tissue)
    form_named(config.form)
    run, plan = Run(config.run), plan_of(config)
    files = {f"motion_{row}": path for row, path in enumerate(plan.files)}
    make = partial(_make_truth, config, plan)
    truth = run.build("truth", config, make, data="synthetic", upstream=files)
    make = partial(_make_corpus, config, plan, truth)
    upstream = {"truth": truth, **files}
    run.build("corpus", config, make, data="synthetic", upstream=upstream)


def _make_truth(config: CorpusConfig, plan: CorpusPlan, writer: ArtifactWriter) -> None:
    """Move every subject and simulate its tissue; every finished sequence is a checkpoint."""
    body = load_body_model(f"embedded:{config.gender}")
    motions = CorpusMotions(body, config.seed)
    thetas = {one.name: motions.procedural(one) for one in plan.dyna}
    thetas |= {one.name: motions.as_read_back(one) for one in plan.held_out}
    recordings, trained = [*plan.dyna, *plan.held_out], {one.name for one in plan.dyna}
    sequences, frames = [], 0
    for one in recordings:
        name, length = one.subject.name, len(thetas[one.name])
        split = "train" if one.name in trained else "test"
        sequences.append(MotionSequence(one.name, name, one.motion, frames, length, FPS, split))
        frames += length
    writer.put("theta", np.concatenate(list(thetas.values())), "rad, last three m")
    subjects = list(dict.fromkeys(one.subject for one in recordings))
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
    work = partial(_simulate, config, offsets, writer.checkpoints.resolve())
    # A task is a subject, or a part of its sequences if there are more cores than subjects.
    parts = math.ceil(usable_cores() / len(subjects))

    def parts_of(subject: Subject) -> list[tuple[Subject, list[tuple[MotionSequence, NDArray]]]]:
        motions = [(one, thetas[one.name]) for one in sequences if one.subject == subject.name]
        return [(subject, motions[part::parts]) for part in range(min(parts, len(motions)))]

    # Threads compete for Python's lock, which half of a step needs.
    kind = "threads" if frames < _FRAMES_WORTH_PROCESSES else "processes"
    with (
        progress(what="soft tissue", unit="frame", total=frames) as bar,
        worker_pool(on_any_node(kind), body) as pool,
    ):
        for done in pool.map(work, [part for one in subjects for part in parts_of(one)]):
            bar.update(done)


def _simulate(
    config: CorpusConfig,
    offsets: ArrayFile,
    checkpoints: Path,
    body: BodyModelData,
    item: tuple[Subject, list[tuple[MotionSequence, NDArray[np.float32]]]],
) -> int:
    """Write the offsets of a subject's sequences unless they are done; gives their frames."""
    subject, motions = item
    tissue = tissue_named(config.tissue)(body, subject.betas, gravity=config.gravity)
    for sequence, theta in motions:
        done = checkpoints / f"{sequence.name}.done"
        if not is_written(done, lambda rows=sequence.frames: _digest(offsets.read(rows))):
            simulated = tissue.offsets(theta.astype(np.float64), FPS)
            offsets.write(sequence.start, simulated)
            mark_written(done, _digest(simulated))
    return sum(sequence.length for sequence, _ in motions)


def _digest(offsets: NDArray[np.float32]) -> str:
    return arrays_sha256({"offsets": offsets})


def _make_corpus(
    config: CorpusConfig, plan: CorpusPlan, truth: Artifact, writer: ArtifactWriter
) -> None:
    """Write the files that a user with licences would have, without the truth."""
    body = load_body_model(f"embedded:{config.gender}")
    body.save_smpl_npz(writer.file_path(f"SMPL_{config.gender.upper()}.npz"))
    names = {one.kind: one.source.name for one in plan.held_out if one.source}
    notice = _NOTICE + (_REAL_NOTICE.format(files=", ".join(names.values())) if names else "")
    writer.file_path("NOTICE.txt").write_text(notice, encoding="utf-8")
    motions = CorpusMotions(body, config.seed)
    for recording in plan.held_out:
        motions.write_amass(writer.file_path(f"mosh/{recording.name}_poses.npz"), recording)
    make_form = form_named(config.form)
    form = make_form and make_form(body, config.seed)
    theta, offsets, betas = (truth.array(name) for name in ("theta", "offsets", "betas"))
    static = truth.array("static") if form else None
    rows = subject_rows(sequences_of(truth))
    sequences = [sequence for sequence in sequences_of(truth) if sequence.split != "test"]
    path, frames = writer.file_path(f"dyna_{config.gender}.h5"), sum(s.length for s in sequences)
    with (
        write_dyna(path, body.faces) as add,
        progress(what="meshes", unit="frame", total=frames) as bar,
    ):
        for sequence in sequences:
            shape = np.asarray(betas[rows[sequence.subject]], np.float64)
            motion = np.asarray(theta[sequence.frames], np.float64)
            offsets_m = offsets[sequence.frames]
            if static is not None:
                offsets_m = offsets_m + static[sequence.frames]
            meshes = posed_meshes(body, shape, motion, offsets_m)
            if form:
                meshes = form.registered(sequence.name, meshes, FPS)
            add(sequence.name, meshes)
            bar.update(sequence.length)
    with h5py.File(path, "r+") as file:
        file.attrs["source"] = "synthetic"
    writer.record(
        sequences=to_manifest(sequences),
        source="synthetic",
        gender=config.gender,
        real_motions=names,
    )
