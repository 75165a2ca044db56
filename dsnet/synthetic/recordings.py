"""What is asked of a corpus, and the recordings that it takes: who does which motion how long."""

from __future__ import annotations

import itertools
import re
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from tyro.conf import Fixed

from bridge.errors import DsnetError, did_you_mean, notify
from bridge.motion.cuts import pieces_between_cuts
from bridge.motion.motion_checks import motion_warnings
from bridge.motion.readers import (
    find_motion_files,
    format_of,
    read_motion_file,
    subject_and_motion,
)
from bridge.motion.resampling import load_motion, resampled_frames
from bridge.motion.smoothing import SmoothHz
from bridge.motion.splits import take_suffix
from bridge.options import Bounds, NonNegativeInt, PositiveFloat, Seed
from dsnet.synthetic.motions import DYNA_MOTIONS, HELD_OUT_MOTIONS, WHOLE_S
from dsnet.synthetic.subjects import SUBJECTS, UNSEEN, Gender, Subject

# Table 1: 67 sequences of five women, 66 of five men. The paper counts the women's meshes only.
FULL_FRAMES = {"female": 21_502, "male": 21_000}
_MISSING = {
    *("50021_chicken_wings", "50022_shake_arms", "50025_one_leg_loose"),
    *("50002_shake_shoulders", "50007_chicken_wings", "50009_punching", "50026_one_leg_loose"),
}
MOSH_FPS = 100.0
_KNOWN_PEOPLE = 2
_SHORTEST_S = 1.0
Crossing = Literal["full", "rotating"]


@dataclass(frozen=True)
class CorpusConfig:
    """Make the synthetic corpus and, apart from it, the truth, which no predictor is given.

    Costs 165 kB of disk a frame for the truth and the meshes, half as much again in forms other
    than clean. Most of the time goes into simulating soft tissue; manifests and report state it.
    """

    run: str = "demo"
    """Run to write: runs/NAME/truth and runs/NAME/corpus."""
    seed: Seed = 0
    """Seed of every subject's style of moving."""
    gender: Gender = "female"
    """Gender of the bodies."""
    subjects: Annotated[int, Bounds(1, 5)] = 5
    """Number of subjects."""
    motions: tuple[str, ...] = tuple(DYNA_MOTIONS)
    """Dyna motions; all of them, of all subjects, are the paper's 67 sequences."""
    mean_frames: Annotated[int, Bounds(60)] = 321
    """Mean length of a sequence in frames at 60 fps; the full corpus has the paper's total."""
    mosh_motions: tuple[str, ...] = tuple(HELD_OUT_MOTIONS)
    """Kinds of motion that are held out from training."""
    mosh_seconds: Annotated[float, Bounds(1)] = 5.0
    """Length of each held-out motion in seconds; lying down and getting up may take longer."""
    retakes: Fixed[NonNegativeInt] = 3
    """How many of the motions, the last ones, known people do again and new people too."""
    crossing: Fixed[Crossing] = "full"
    """Who does each held-out kind: two known and three new people, or one of each in rotation."""
    amass: Path | None = None
    """Folder of AMASS files or BVHs: real motions as further test takes, with simulated tissue."""
    amass_seconds: PositiveFloat = 20.0
    """Seconds of each real motion that are used at most, from its beginning."""
    amass_fps: PositiveFloat | None = None
    """Frame rate of these files in frames per second, where they have a wrong one."""
    amass_smooth_hz: PositiveFloat | Literal["auto"] | None = None
    """Cutoff in Hz of a low-pass filter on these motions, for noisy recordings; `auto` finds the
    cutoff that suits each moment."""
    tissue: str = "own"
    """Law of the soft tissue: `own`, or one of a module that DSNET_PLUGINS names."""
    form: str = "clean"
    """What the meshes have besides soft tissue: nothing (`clean`), or a form of such a module."""
    gravity: Fixed[bool] = True
    """Whether turned limbs hang."""


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


class CorpusPlan(NamedTuple):
    """All recordings of a corpus: what is trained on and validated, and what is only predicted."""

    dyna: list[Recording]
    held_out: list[Recording]  # one person after another, the known people first
    files: list[Path]  # where the real motions are from


def plan_of(config: CorpusConfig) -> CorpusPlan:
    """The recordings that a configuration asks for; nothing is made yet."""
    # Of bodies of any gender: no body of theirs is used.
    files = find_motion_files(config.amass, "any") if config.amass else []
    dyna, held_out = _dyna(config), [*_held_out(config), *_real(config, files)]
    order = [one.name for one in (*SUBJECTS[config.gender], *UNSEEN[config.gender])]
    held_out.sort(key=lambda recording: order.index(recording.subject.name))
    return CorpusPlan(dyna, held_out, files)


def _dyna(config: CorpusConfig) -> list[Recording]:
    """Sequences of the first subjects, by subject and then by motion.

    With every subject and every motion this is the full corpus, of exactly as many sequences
    and frames as the paper's; otherwise lengths differ by a tenth about `mean_frames`.
    """
    motions, gender = config.motions, config.gender
    if not motions:
        raise DsnetError("no motions", f"some of {', '.join(DYNA_MOTIONS)}", "Pass --motions hips.")
    _check_names(motions, DYNA_MOTIONS)
    people = SUBJECTS[gender][: config.subjects]
    if people == SUBJECTS[gender] and set(motions) == set(DYNA_MOTIONS):
        pairs = itertools.product(people, DYNA_MOTIONS)
        pairs = [(who, what) for who, what in pairs if f"{who.name}_{what}" not in _MISSING]
        lengths = _full_lengths(len(pairs), FULL_FRAMES[gender], config.seed)
        return [Recording(*pair, length) for pair, length in zip(pairs, lengths, strict=True)]
    pairs = itertools.product(people, motions)
    return [Recording(who, what, _length(config, f"{who.name}_{what}")) for who, what in pairs]


def _full_lengths(sequences: int, total: int, seed: int) -> list[int]:
    """Lengths as in Figure 6: most between 200 and 400 frames, few of 2 s or of 15 s."""
    rng = np.random.default_rng([seed, total])
    lengths = np.clip(rng.lognormal(np.log(300), 0.28, sequences), 150, 700)
    lengths[:3] = 120, 800, 900
    lengths[3:] *= (total - lengths[:3].sum()) / lengths[3:].sum()
    whole = lengths.astype(int)
    whole[3 : 3 + total - whole.sum()] += 1
    return rng.permutation(whole).tolist()


def _length(config: CorpusConfig, name: str) -> int:
    rng = np.random.default_rng((config.seed, zlib.crc32(name.encode())))
    return round(config.mean_frames * rng.uniform(0.91, 1.09))


def _held_out(config: CorpusConfig) -> list[Recording]:
    """What no stage sees before prediction, in the four cells of `bridge.motion.splits`.

    Kinds that nobody was trained on and the last kinds of training, each by people of training and
    by new ones; who was trained on a kind does it in another style, as take 2.
    """
    _check_names(config.mosh_motions, HELD_OUT_MOTIONS)
    known = config.motions[max(0, len(config.motions) - config.retakes) :]
    found = []
    for row, kind in enumerate((*config.mosh_motions, *known)):
        frames = round(max(config.mosh_seconds, WHOLE_S.get(kind, 0.0)) * MOSH_FPS) + 1
        people, new = _people_of_kind(config, row, config.crossing)
        number = 2 if kind in known else 1
        found += [Recording(person, kind, frames, number) for person in people]
        found += [Recording(person, kind, frames) for person in new]
    return found


def _people_of_kind(
    config: CorpusConfig, row: int, crossing: Crossing
) -> tuple[tuple[Subject, ...], tuple[Subject, ...]]:
    """Who of the known and who of the new people does held-out kind number `row`.

    `full`: the first two and all new ones. `rotating`: one and one, the next for the next kind.
    """
    known, new = SUBJECTS[config.gender][: config.subjects], UNSEEN[config.gender]
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


def _real(config: CorpusConfig, files: Iterable[Path]) -> list[Recording]:
    """Each real motion done by one known and one new person, the next ones for the next motion.

    Of one that jumps what comes before is used, for to simulated tissue a jump is a blow. What is
    shorter than a second is left out, and what moves as nobody can is taken as it is, each with a
    line on stderr. The names of motions whose rate is told, or that are smoothed, have that.
    """
    found: list[Recording] = []
    smooth_hz = config.amass_smooth_hz
    for row, (path, kind) in enumerate(_kinds(files)):
        stored = read_motion_file(path)
        fps = config.amass_fps or stored.fps
        if np.isnan(fps):
            notify(f"{path}: left out; it does not say its rate, --amass-fps does")
            continue
        frames = min(len(stored.pose), int(config.amass_seconds * fps) + 1)
        first, *others = pieces_between_cuts(stored.theta[:frames])
        if others:
            frames = first.stop
            notify(f"{path}: used up to {frames / fps:.2f} s, where it jumps")
        if frames - 1 < _SHORTEST_S * fps:
            notify(f"{path}: left out; shorter than {_SHORTEST_S:g} s")
            continue
        motion = load_motion(path, fps, smooth_hz=smooth_hz)
        used = slice(0, resampled_frames(frames, fps))
        for warning in motion_warnings(motion, [used], "--amass-fps", "--amass-smooth-hz auto"):
            notify(warning)
        if config.amass_fps is not None:
            kind += f"_at_{config.amass_fps:g}_hz"
        if smooth_hz is not None:
            kind += "_smoothed" if smooth_hz == "auto" else f"_smoothed_{smooth_hz:g}_hz"
        known, new = _people_of_kind(config, row, "rotating")
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
