"""`dsnet corpus`: the synthetic corpus in the formats of SMPL, Dyna and AMASS, and its truth."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from bridge.body import load_body_model
from bridge.body.posing import shaped_joints
from bridge.errors import DsnetError
from bridge.motion import MotionSequence, sequences_of, subject_rows, to_manifest
from bridge.motion.resampling import load_amass_motion
from bridge.options import PositiveFloat, PositiveInt, Seed
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.runs.worker_pool import worker_pool
from torch_align_ae.body import SMPL
from torch_align_ae.corpus.amass_files import write_amass_motion
from torch_align_ae.corpus.dyna_files import FPS, write_dyna
from torch_align_ae.corpus.motions import DYNA_MOTIONS, MOSH_MOTIONS, Skeleton, perform
from torch_align_ae.corpus.sequences import MOSH_FPS, Take, dyna_takes, mosh_takes
from torch_align_ae.corpus.simulation import TissueSimulator, body_in_double, posed_meshes
from torch_align_ae.corpus.subjects import Gender, Subject

_NOTICE = """\
Synthetic data. Bodies, motions and soft tissue are computed; no person was measured.
The files have the formats of SMPL, Dyna and AMASS, but are none of these data sets.
The body derives from the MakeHuman assets (CC0).
"""


@dataclass(frozen=True)
class CorpusConfig:
    """Make the synthetic corpus and, apart from it, the truth that only evaluation may read.

    Costs 165 kB of disk a frame for the truth and as much for the meshes, and time for the soft
    tissue above all; what it took stands in the manifests and the report.
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
    mosh_motions: tuple[str, ...] = tuple(MOSH_MOTIONS)
    """Held-out MoSh-like motions, each done by two known subjects and an unseen one."""
    mosh_seconds: PositiveFloat = 5.0
    """Length of each MoSh-like motion."""


PROFILES: dict[str, CorpusConfig] = {
    "smoke": CorpusConfig(
        subjects=2,
        motions=("one_leg_jump", "hips"),
        mean_frames=72,
        mosh_motions=("side_to_side_hopping",),
        mosh_seconds=1.2,
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
        mosh_seconds=4.0,
    ),
    "paper": CorpusConfig(),
}


def main(config: CorpusConfig) -> None:
    """Make `truth`, then `corpus` from it."""
    run = Run(config.run)
    truth = run.build(
        "truth", config, lambda writer: _make_truth(writer, config), data="synthetic", upstream={}
    )
    run.build(
        "corpus",
        config,
        lambda writer: _make_corpus(writer, config, truth),
        data="synthetic",
        upstream={"truth": truth},
    )


def _takes(config: CorpusConfig) -> tuple[list[Take], list[Take]]:
    """Dyna's sequences and MoSh's."""
    if min(config.mean_frames, config.mosh_seconds * FPS) < 60:
        raise DsnetError(
            f"mean_frames={config.mean_frames}, mosh_seconds={config.mosh_seconds:g}",
            "at least 60 frames and 1 second",
            "Longer sequences, fewer motions or subjects.",
        )
    dyna = dyna_takes(
        config.gender, config.subjects, config.motions, config.mean_frames, config.seed
    )
    return dyna, mosh_takes(
        config.gender, config.subjects, config.mosh_motions, config.mosh_seconds
    )


def _make_truth(writer: ArtifactWriter, config: CorpusConfig) -> None:
    """Move every subject and simulate its tissue; every finished sequence is a checkpoint."""
    smpl = body_in_double(load_body_model(f"embedded:{config.gender}"))
    dyna, mosh = _takes(config)
    thetas = {
        **{take.name: _perform(smpl, take, FPS, config.seed) for take in dyna},
        **{take.name: _read_back(smpl, take, config) for take in mosh},
    }
    sequences = list(_index([*dyna, *mosh], thetas, test={take.name for take in mosh}))
    frames = sum(sequence.length for sequence in sequences)
    writer.put("theta", np.concatenate(list(thetas.values())), "rad, last three m")
    subjects = list(dict.fromkeys(take.subject for take in (*dyna, *mosh)))
    writer.put("betas", np.array([subject.betas for subject in subjects], np.float32), "1")
    shape = (frames, smpl.vertex_count, 3)
    offsets = writer.open_array("offsets", shape, np.float32, "m")
    writer.record(sequences=to_manifest(sequences), source="synthetic", gender=config.gender)
    with tqdm(total=frames, desc="soft tissue", unit="frame", disable=None) as progress:

        def simulate(smpl: SMPL, subject: Subject) -> None:
            own = [sequence for sequence in sequences if sequence.subject == subject.name]
            _simulate_subject(smpl, subject, own, thetas, offsets, writer.checkpoints, progress)

        # A subject a core: the sparse solves release Python's lock, and no subject needs another.
        with worker_pool("threads", smpl) as pool:
            for _ in pool.map(simulate, subjects):
                pass


def _simulate_subject(
    smpl: SMPL,
    subject: Subject,
    sequences: list[MotionSequence],
    thetas: dict[str, NDArray[np.float32]],
    offsets: NDArray[np.float32],
    checkpoints: Path,
    progress: tqdm,
) -> None:
    simulator = TissueSimulator(smpl, subject.betas)
    for sequence in sequences:
        done = checkpoints / f"{sequence.name}.done"
        if not done.exists():
            theta = thetas[sequence.name].astype(np.float64)
            offsets[sequence.frames] = simulator.offsets(theta, FPS)
            offsets.flush()  # type: ignore[attr-defined]
            done.touch()
        progress.update(sequence.length)


def _perform(smpl: SMPL, take: Take, fps: float, seed: int) -> NDArray[np.float32]:
    """theta as it is stored: what the simulation follows is exactly what a reader gets."""
    skeleton = Skeleton.of(smpl.data, take.subject.betas)
    name, count = take.subject.name, take.frame_count
    theta = perform(take.motion, name, skeleton, frame_count=count, fps=fps, seed=seed)
    return theta.astype(np.float32)


def _read_back(smpl: SMPL, take: Take, config: CorpusConfig) -> NDArray[np.float32]:
    """A MoSh-like motion as every reader of its file sees it: at 60 fps, y up."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "motion.npz"
        _write_mosh(path, smpl, take, config)
        motion = load_amass_motion(path, root_joint_m=_root_joint_m(smpl, take.subject), fps=FPS)
    return motion.theta.astype(np.float32)


def _write_mosh(path: Path, smpl: SMPL, take: Take, config: CorpusConfig) -> None:
    write_amass_motion(
        path,
        _perform(smpl, take, MOSH_FPS, config.seed).astype(np.float64),
        betas=take.subject.betas,
        gender=config.gender,
        fps=MOSH_FPS,
        root_joint_m=_root_joint_m(smpl, take.subject),
    )


def _root_joint_m(smpl: SMPL, subject: Subject) -> NDArray[np.float64]:
    return shaped_joints(smpl.data, subject.betas[None])[0, 0]


def _index(
    takes: list[Take], thetas: dict[str, NDArray[np.float32]], test: set[str]
) -> Iterator[MotionSequence]:
    start = 0
    for take in takes:
        length, split = len(thetas[take.name]), "test" if take.name in test else "train"
        yield MotionSequence(take.name, take.subject.name, take.motion, start, length, FPS, split)
        start += length


def _make_corpus(writer: ArtifactWriter, config: CorpusConfig, truth: Artifact) -> None:
    """Write the files that a licensed user would have, and nothing of the truth."""
    data = load_body_model(f"embedded:{config.gender}")
    smpl = body_in_double(data)
    data.save_smpl_npz(writer.file_path(f"SMPL_{config.gender.upper()}.npz"))
    writer.file_path("NOTICE.txt").write_text(_NOTICE, encoding="utf-8")
    for take in _takes(config)[1]:
        _write_mosh(writer.file_path(f"mosh/{take.name}_poses.npz"), smpl, take, config)
    path = writer.file_path(f"dyna_{config.gender}.h5")
    _write_meshes(path, smpl, truth)
    with h5py.File(path, "r+") as file:
        file.attrs["source"] = "synthetic"
    sequences = [sequence for sequence in sequences_of(truth) if sequence.split != "test"]
    writer.record(sequences=to_manifest(sequences), source="synthetic", gender=config.gender)


def _write_meshes(path: Path, smpl: SMPL, truth: Artifact) -> None:
    theta, offsets = truth.array("theta"), truth.array("offsets")
    betas, sequences = truth.array("betas"), sequences_of(truth)
    rows = subject_rows(sequences)
    dyna = [sequence for sequence in sequences if sequence.split != "test"]
    frames = sum(sequence.length for sequence in dyna)
    with (
        write_dyna(path, smpl.data.faces) as file,
        tqdm(total=frames, desc="meshes", unit="frame", disable=None) as progress,
    ):
        for sequence in dyna:
            shape = np.asarray(betas[rows[sequence.subject]], np.float64)
            own_theta = np.asarray(theta[sequence.frames], np.float64)
            meshes = posed_meshes(smpl, shape, own_theta, offsets[sequence.frames])
            file.add(sequence.name, meshes)
            progress.update(sequence.length)
