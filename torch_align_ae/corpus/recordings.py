"""Which subjects do which motions for how long, and which real motions they follow besides."""

from __future__ import annotations

import itertools
import re
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from bridge.errors import DsnetError, did_you_mean, notify
from bridge.motion.cuts import find_cuts
from bridge.motion.motion_checks import motion_warnings
from bridge.motion.readers import format_of, read_motion_file, subject_and_motion
from bridge.motion.resampling import load_motion_file, resampled_frames
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
_KNOWN_PEOPLE = 2
_SHORTEST_S = 1.0
Crossing = Literal["full", "rotating"]


@dataclass(frozen=True)
class Recording:
    """One sequence to be made: a subject who does a kind of motion."""

    subject: Subject
    kind: str  # a name of `MOTIONS`, or `amass_<file>` for a real motion
    frame_count: int  # at the rate of its own file: 60 fps for Dyna's, 100 fps for MoSh-like ones
    number: int = 1  # 2 where the same person does a kind again, in another style
    source: Path | None = None  # file of a real motion; None for a procedural one
    source_fps: float | None = None
    smooth_hz: SmoothHz | None = None  # what is faster in that file is left out

    @property
    def motion(self) -> str:
        """The kind, and `_take2` where it is done again."""
        return self.kind if self.number == 1 else f"{self.kind}{take_suffix(self.number)}"

    @property
    def name(self) -> str:
        return f"{self.subject.name}_{self.motion}"


def dyna_recordings(
    gender: Gender, subjects: int, motions: tuple[str, ...], mean_frames: int, seed: int
) -> list[Recording]:
    """Sequences of the first `subjects` subjects, by subject and then by motion.

    With every subject and every motion this is the full corpus, of exactly as many sequences
    and frames as the paper's; otherwise lengths differ by a tenth about `mean_frames`.
    """
    if not motions:
        raise DsnetError("no motions", f"some of {', '.join(DYNA_MOTIONS)}", "Pass --motions hips.")
    _check_names(motions, DYNA_MOTIONS)
    everybody = SUBJECTS[gender]
    if not 1 <= subjects <= len(everybody):
        raise DsnetError(f"{subjects} subjects", f"1 to {len(everybody)}", "Pass --subjects 5.")
    is_full = subjects == len(everybody) and set(motions) == set(DYNA_MOTIONS)
    pairs = itertools.product(everybody[:subjects], DYNA_MOTIONS if is_full else motions)
    if is_full:
        pairs = [(who, what) for who, what in pairs if (who.name, what) not in _MISSING[gender]]
        lengths = _full_lengths(len(pairs), FULL_FRAMES[gender], seed)
        return [Recording(*pair, length) for pair, length in zip(pairs, lengths, strict=True)]
    return [Recording(who, what, _length(who.name, what, mean_frames, seed)) for who, what in pairs]


def _full_lengths(sequences: int, total: int, seed: int) -> list[int]:
    """Lengths as in Figure 6: most between 200 and 400 frames, few of 2 s or of 15 s."""
    rng = np.random.default_rng([seed, total])
    lengths = np.clip(rng.lognormal(np.log(300), 0.28, sequences), 150, 700)
    lengths[:3] = 120, 800, 900
    lengths[3:] *= (total - lengths[:3].sum()) / lengths[3:].sum()
    whole = lengths.astype(int)
    whole[3 : 3 + total - whole.sum()] += 1
    return rng.permutation(whole).tolist()


def _length(subject: str, motion: str, mean_frames: int, seed: int) -> int:
    entropy = (seed, zlib.crc32(f"{subject}_{motion}".encode()))
    return round(mean_frames * np.random.default_rng(entropy).uniform(0.91, 1.09))


def held_out_recordings(
    gender: Gender,
    subjects: int,
    *,
    unseen: tuple[str, ...],
    known: tuple[str, ...],
    seconds: float,
    crossing: Crossing,
) -> list[Recording]:
    """What no stage sees before prediction, in the four cells of `bridge.motion.splits`.

    Kinds that nobody was trained on (`unseen`) and kinds of training (`known`), each by people of
    training and by new ones; who was trained on a kind does it in another style, as take 2.
    """
    _check_names(unseen, HELD_OUT_MOTIONS)
    _check_names(known, DYNA_MOTIONS)
    found = []
    for row, kind in enumerate((*unseen, *known)):
        frames = round(max(seconds, WHOLE_S.get(kind, 0.0)) * MOSH_FPS) + 1
        people, new = _people_of_kind(gender, subjects, row, crossing)
        number = 2 if kind in known else 1
        found += [Recording(person, kind, frames, number) for person in people]
        found += [Recording(person, kind, frames) for person in new]
    return found


def _people_of_kind(
    gender: Gender, subjects: int, row: int, crossing: Crossing
) -> tuple[tuple[Subject, ...], tuple[Subject, ...]]:
    """Who of the known and who of the new people does held-out kind number `row`.

    `full`: the first two and all new ones. `rotating`: one and one, the next for the next kind.
    """
    known, new = SUBJECTS[gender][:subjects], UNSEEN[gender]
    if crossing == "full":
        return known[:_KNOWN_PEOPLE], new
    return (known[row % len(known)],), (new[row % len(new)],)


def _check_names(motions: tuple[str, ...], known: Iterable[str]) -> None:
    if unknown := sorted(set(motions) - set(known)):
        remedy = did_you_mean(unknown[0], known, "Check their names.")
        raise DsnetError(f"motions {', '.join(unknown)}", f"among {', '.join(known)}", remedy)
    if repeated := sorted({motion for motion in motions if motions.count(motion) > 1}):
        received = f"motions {', '.join(repeated)} more than once"
        raise DsnetError(received, "each once", "Leave out the second.")


def real_recordings(
    files: Iterable[Path],
    gender: Gender,
    subjects: int,
    longest_s: float,
    source_fps: float | None = None,
    smooth_hz: SmoothHz | None = None,
) -> list[Recording]:
    """Each real motion done by one known and one new person, the next ones for the next motion.

    Of a long motion the first `longest_s` are used, of one that jumps what comes before it does,
    for to simulated tissue a jump is a blow. What is shorter than a second is left out, and what
    moves as nobody can is taken as it is, each with a line on stderr. `source_fps` is the rate of
    all files, where what they say of themselves is wrong; what is faster than `smooth_hz` is left
    out; their names then have it.
    """
    found: list[Recording] = []
    for row, (path, kind) in enumerate(_kinds(files)):
        stored = read_motion_file(path)
        fps = source_fps or stored.fps
        if np.isnan(fps):
            notify(f"{path}: left out; it does not say its rate, --amass-fps does")
            continue
        frames = min(len(stored.pose), int(longest_s * fps) + 1)
        if jumps := find_cuts(stored.pose[:frames], stored.trans_m[:frames]):
            frames = jumps[0]
            notify(f"{path}: used up to {frames / fps:.2f} s, where it jumps")
        if frames - 1 < _SHORTEST_S * fps:
            notify(f"{path}: left out; shorter than {_SHORTEST_S:g} s")
            continue
        motion = load_motion_file(path, fps, smooth_hz=smooth_hz)
        used = slice(0, resampled_frames(frames, fps))
        for warning in motion_warnings(motion, [used], "--amass-fps", "--amass-smooth-hz auto"):
            notify(warning)
        if source_fps is not None:
            kind += f"_at_{source_fps:g}_hz"
        if smooth_hz is not None:
            kind += "_smoothed" if smooth_hz == "auto" else f"_smoothed_{smooth_hz:g}_hz"
        known, new = _people_of_kind(gender, subjects, row, "rotating")
        found += [
            Recording(person, kind, frames, source=path, source_fps=fps, smooth_hz=smooth_hz)
            for person in (*known, *new)
        ]
    return found


def _kinds(files: Iterable[Path]) -> Iterator[tuple[Path, str]]:
    """`amass_<motion>` or `bvh_<motion>` of each, in letters, digits and underscores, a second one
    of a name `_2`; a motion that is but a number has its person's before it, as CMU's `05_06`."""
    taken: set[str] = set()
    for path in files:
        subject, motion = subject_and_motion(path)
        whole = f"{subject}_{motion}" if motion.isdecimal() else motion
        name = f"{format_of(path)}_" + re.sub(r"\W+", "_", whole)
        names = itertools.chain([name], (f"{name}_{number}" for number in itertools.count(2)))
        kind = next(one for one in names if one not in taken)
        taken.add(kind)
        yield path, kind
