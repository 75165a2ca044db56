"""Which subjects do which motions for how long, in each profile."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from bridge.errors import DsnetError, did_you_mean
from bridge.motion.smoothing import SmoothHz
from bridge.motion.splits import take_suffix
from torch_align_ae.corpus.motions import DYNA_MOTIONS, HELD_OUT_MOTIONS, WHOLE_S
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
_KNOWN_PERFORMERS = 2
Crossing = Literal["full", "rotating"]


@dataclass(frozen=True)
class Take:
    """One sequence to be made."""

    subject: Subject
    kind: str
    """Kind of motion: a name of `MOTIONS`, or `amass_<file>` for a real one."""
    frame_count: int
    """At the rate of its own file: 60 fps for Dyna's, 100 fps for MoSh-like ones."""
    number: int = 1
    """2 where the same person does a kind again, in another style."""
    source: Path | None = None
    """File of a real motion; None for a procedural one."""
    source_fps: float | None = None
    """Frames per second of that file."""
    smooth_hz: SmoothHz | None = None
    """What is faster in that file is left out."""

    @property
    def motion(self) -> str:
        """The kind, and `_take2` where it is done again."""
        return self.kind if self.number == 1 else f"{self.kind}{take_suffix(self.number)}"

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


def held_out_takes(
    gender: Gender,
    subjects: int,
    *,
    unseen: tuple[str, ...],
    known: tuple[str, ...],
    seconds: float,
    crossing: Crossing,
) -> list[Take]:
    """What no stage sees before prediction, in the four cells of `bridge.motion.splits`.

    Kinds that nobody was trained on (`unseen`) and kinds of training (`known`), each by people of
    training and by new ones; who was trained on a kind does it in another style, as take 2.

    Raises
    ------
    DsnetError
        If there is no such kind, or one is named twice.
    """
    _check_names(unseen, HELD_OUT_MOTIONS)
    _check_names(known, DYNA_MOTIONS)
    takes = []
    for row, kind in enumerate((*unseen, *known)):
        count = round(max(seconds, WHOLE_S.get(kind, 0.0)) * MOSH_FPS) + 1
        people, new = performers(gender, subjects, row, crossing)
        takes += [Take(person, kind, count, 2 if kind in known else 1) for person in people]
        takes += [Take(person, kind, count) for person in new]
    return takes


def performers(
    gender: Gender, subjects: int, row: int, crossing: Crossing
) -> tuple[tuple[Subject, ...], tuple[Subject, ...]]:
    """Who of the known and who of the new people does held-out kind number `row`.

    `full`: the first two and all new ones. `rotating`: one and one, the next for the next kind.
    """
    known, new = SUBJECTS[gender][:subjects], UNSEEN[gender]
    if crossing == "full":
        return known[:_KNOWN_PERFORMERS], new
    return (known[row % len(known)],), (new[row % len(new)],)


def by_subject(takes: Iterable[Take], gender: Gender) -> list[Take]:
    """The takes of one person after another, the known people first."""
    order = [subject.name for subject in (*SUBJECTS[gender], *UNSEEN[gender])]
    return sorted(takes, key=lambda take: order.index(take.subject.name))


def _check_names(motions: tuple[str, ...], known: Iterable[str]) -> None:
    if unknown := sorted(set(motions) - set(known)):
        remedy = did_you_mean(unknown[0], known, "Check their names.")
        raise DsnetError(f"motions {', '.join(unknown)}", f"among {', '.join(known)}", remedy)
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
