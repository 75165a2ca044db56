"""Sequences whose poses and offsets are known: simulated for the comparison, kept on disk."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from bridge.body import BodyModelData, load_body_model
from bridge.exchange import load_weights, save_weights
from bridge.paper import FPS
from dsnet.synthetic.motions import Skeleton, perform
from dsnet.synthetic.simulation import TissueSimulator, posed_meshes
from dsnet.synthetic.subjects import SUBJECTS, UNSEEN, Gender, Subject


@dataclass(frozen=True)
class Suite:
    """Which sequences an aligner is measured on."""

    name: str
    """`tuning` or `held_out`."""
    seed: int
    """Seed of the subjects' styles of moving."""
    pairs: tuple[tuple[str, str], ...]
    """Subject and motion of each sequence."""
    frames: int = 120
    """Length of each."""


# Settings of aligners may be chosen on these ...
TUNING = Suite(
    "tuning",
    seed=0,
    pairs=tuple(
        (subject, motion)
        for subject in ("50004", "50020", "50022")
        for motion in ("one_leg_jump", "jiggle_on_toes", "shake_arms", "hips", "running_on_spot")
    ),
)
# ... and not on these: other subjects, one of them heavy, other motions, other styles.
HELD_OUT = Suite(
    "held_out",
    seed=7,
    pairs=(
        ("50021", "knees"),
        ("50021", "punching"),
        ("50025", "light_hopping_stiff"),
        ("50025", "shake_hips"),
        ("99001", "one_leg_loose"),
        ("99001", "shake_shoulders"),
        ("50002", "light_hopping_stiff"),
        ("50002", "chicken_wings"),
        ("50026", "knees"),
        ("50026", "shake_hips"),
        ("50027", "one_leg_loose"),
        ("50027", "punching"),
    ),
)


@dataclass(frozen=True)
class KnownRecording:
    """What an aligner is given."""

    name: str
    """`<subject>_<motion>`."""
    subject: str
    """Who is moving."""
    gender: Gender
    """Which body model fits."""
    meshes_m: NDArray[np.float32]
    """(T, V, 3) registered meshes."""


@dataclass(frozen=True)
class KnownSequence:
    """A recording, and what it was made from."""

    recording: KnownRecording
    betas: NDArray[np.float64]
    """(10,)."""
    theta: NDArray[np.float32]
    """(T, 69)."""
    offsets_m: NDArray[np.float32]
    """(T, V, 3) in the rest pose."""


def known_sequences(suite: Suite, folder: Path) -> list[KnownSequence]:
    """The sequences of a suite, about 3 s each to make; those in `folder` are read from there.

    Files are named after what they hold. Delete them when the simulation has changed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    progress = tqdm(suite.pairs, desc="sequences", unit="sequence", disable=None)
    return [_known(suite, subject, motion, folder) for subject, motion in progress]


def _known(suite: Suite, subject_name: str, motion: str, folder: Path) -> KnownSequence:
    gender, subject = _person(subject_name)
    name = f"{subject_name}_{motion}"
    path = folder / f"{name}_{suite.frames}_frames_seed_{suite.seed}.safetensors"
    if not path.is_file():
        save_weights(path, _simulate(gender, subject, motion, suite))
    stored = load_weights(path)
    recording = KnownRecording(name, subject_name, gender, stored["meshes"])
    return KnownSequence(recording, subject.betas, stored["theta"], stored["offsets"])


def _person(name: str) -> tuple[Gender, Subject]:
    for gender, people in SUBJECTS.items():
        for subject in (*people, *UNSEEN[gender]):
            if subject.name == name:
                return gender, subject
    raise ValueError(f"no subject {name}")


def _simulate(
    gender: Gender, subject: Subject, motion: str, suite: Suite
) -> dict[str, NDArray[np.float32]]:
    body, simulator = _body(gender), _simulator(gender, subject)
    theta = perform(
        motion,
        subject.name,
        Skeleton(body, subject.betas),
        frame_count=suite.frames,
        fps=FPS,
        seed=suite.seed,
    ).astype(np.float32)
    stored_theta = theta.astype(np.float64)
    offsets_m = simulator.offsets(stored_theta, FPS)
    meshes_m = posed_meshes(body, subject.betas, stored_theta, offsets_m)
    return {"theta": theta, "offsets": offsets_m, "meshes": meshes_m}


@cache
def _body(gender: Gender) -> BodyModelData:
    return load_body_model(f"embedded:{gender}")


@cache
def _simulator(gender: Gender, subject: Subject) -> TissueSimulator:
    """One for all motions of a subject: factorising its stiffness takes most of the time."""
    return TissueSimulator(_body(gender), subject.betas)
