"""Which subjects do which motions for how long, in each profile."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from bridge.errors import DsnetError
from torch_align_ae.corpus.motions import DYNA_MOTIONS, MOSH_MOTIONS
from torch_align_ae.corpus.subjects import SUBJECTS, UNSEEN, Gender, Subject

# Table 1: 67 sequences of five women, 66 of five men. The paper counts the women's meshes only.
FULL_FRAMES = {"female": 21_502, "male": 21_000}
_MISSING = {
    "female": {("50021", "chicken_wings"), ("50022", "shake_arms"), ("50025", "one_leg_loose")},
    "male": {
        ("50002", "shake_shoulders"),
        ("50007", "chicken_wings"),
        ("50009", "punching"),
        ("50026", "one_leg_loose"),
    },
}
MOSH_FPS = 100.0


@dataclass(frozen=True)
class Take:
    """One sequence to be made."""

    subject: Subject
    motion: str
    frame_count: int
    """At the rate of its own file: 60 fps for Dyna's, 100 fps for MoSh-like ones."""

    @property
    def name(self) -> str:
        """`<subject>_<motion>`."""
        return f"{self.subject.name}_{self.motion}"


def dyna_takes(
    gender: Gender, subjects: int, motions: tuple[str, ...], mean_frames: int, seed: int
) -> list[Take]:
    """Sequences of the first `subjects` subjects, by subject and then by motion.

    With every subject and every motion this is the full corpus, of exactly as many sequences
    and frames as the paper's; otherwise lengths differ by a tenth about `mean_frames`.

    Raises
    ------
    DsnetError
        If there is no such motion, one is named twice or none at all, or there are not as many
        subjects.
    """
    if not motions:
        raise DsnetError("no motions", f"some of {', '.join(DYNA_MOTIONS)}", "Pass --motions hips.")
    _check_names(motions, DYNA_MOTIONS)
    if not 1 <= subjects <= len(SUBJECTS[gender]):
        raise DsnetError(
            f"{subjects} subjects", f"1 to {len(SUBJECTS[gender])}", "Pass --subjects 5."
        )
    people = SUBJECTS[gender][:subjects]
    if len(people) == len(SUBJECTS[gender]) and set(motions) == set(DYNA_MOTIONS):
        return _full_corpus(gender, seed)
    return [
        Take(subject, motion, _length(subject.name, motion, mean_frames, seed))
        for subject in people
        for motion in motions
    ]


def mosh_takes(
    gender: Gender, subjects: int, motions: tuple[str, ...], seconds: float
) -> list[Take]:
    """Held-out motions of two of the known subjects and of one that no stage has seen.

    Raises
    ------
    DsnetError
        If there is no such motion, or one is named twice.
    """
    _check_names(motions, MOSH_MOTIONS)
    people = (*SUBJECTS[gender][: min(2, subjects)], UNSEEN[gender])
    count = round(seconds * MOSH_FPS) + 1
    return [Take(subject, motion, count) for subject in people for motion in motions]


def _check_names(motions: tuple[str, ...], known: Iterable[str]) -> None:
    if unknown := sorted(set(motions) - set(known)):
        raise DsnetError(
            f"motions {', '.join(unknown)}", f"among {', '.join(known)}", "Check their names."
        )
    if repeated := sorted({motion for motion in motions if motions.count(motion) > 1}):
        raise DsnetError(
            f"motions {', '.join(repeated)} more than once", "each once", "Leave out the second."
        )


def _full_corpus(gender: Gender, seed: int) -> list[Take]:
    pairs = [
        (subject, motion)
        for subject in SUBJECTS[gender]
        for motion in DYNA_MOTIONS
        if (subject.name, motion) not in _MISSING[gender]
    ]
    lengths = _full_lengths(len(pairs), FULL_FRAMES[gender], seed)
    return [Take(*pair, length) for pair, length in zip(pairs, lengths, strict=True)]


def _full_lengths(count: int, total: int, seed: int) -> list[int]:
    """Lengths as in Figure 6: most between 200 and 400 frames, few of 2 s or of 15 s."""
    rng = np.random.default_rng([seed, total])
    lengths = np.clip(rng.lognormal(np.log(300), 0.28, count), 150, 700)
    lengths[:3] = 120, 800, 900
    lengths[3:] *= (total - lengths[:3].sum()) / lengths[3:].sum()
    whole = lengths.astype(int)
    whole[3 : 3 + total - whole.sum()] += 1
    return rng.permutation(whole).tolist()


def _length(subject: str, motion: str, mean_frames: int, seed: int) -> int:
    entropy = (seed, zlib.crc32(f"{subject}_{motion}".encode()))
    return round(mean_frames * np.random.default_rng(entropy).uniform(0.91, 1.09))
