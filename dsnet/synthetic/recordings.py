"""Options of a corpus, and the list of its recordings: subjects, motions and lengths."""

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
_TRAINED_SUBJECTS = 2
"""Subjects of training that do every held-out kind with `crossing` full."""
_SHORTEST_S = 1.0
Crossing = Literal["full", "rotating"]


@dataclass(frozen=True)
class CorpusConfig:
    """Make the synthetic corpus and, separately, the truth, which no predictor receives.

    Costs 165 kB of disk a frame for the truth and the meshes, half as much again in forms other
    than clean. Most of the time goes into simulating soft tissue; manifests and report state it.
    """

    run: str = "demo"
    """Run to write: runs/NAME/truth and runs/NAME/corpus."""
    seed: Seed = 0
    """Seed of the subjects' styles of motion."""
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
    """How many training motions, the last ones, are test motions too: by subjects of training in
    another style, and by new subjects."""
    crossing: Fixed[Crossing] = "full"
    """Subjects of each held-out kind: two of training and three new ones, or one of each in
    rotation."""
    amass: Path | None = None
    """Folder of AMASS files or BVHs: further test motions, real, with simulated tissue."""
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
    """Whether gravity acts on the soft tissue of rotated limbs."""


@dataclass(frozen=True)
class Recording:
    """One sequence to be made: a kind of motion by a subject."""

    subject: Subject
    kind: str  # a name of `MOTIONS`, or `amass_<file>` for a real motion
    frame_count: int  # at the rate of its own file: 60 fps for Dyna's, 100 fps for MoSh-like ones
    number: int = 1  # 2 for the same kind by the same subject in another style
    source: Path | None = None  # file of a real motion; None for a procedural one
    source_fps: float | None = None
    smooth_hz: SmoothHz | None = None  # cutoff of the low-pass filter for that file

    @property
    def motion(self) -> str:
        """The kind, with the suffix `_take2` if it is done again."""
        return self.kind if self.number == 1 else f"{self.kind}{take_suffix(self.number)}"

    @property
    def name(self) -> str:
        return f"{self.subject.name}_{self.motion}"


class CorpusPlan(NamedTuple):
    """All recordings of a corpus: those of training and validation, and the held-out ones."""

    dyna: list[Recording]
    held_out: list[Recording]  # subject by subject, those of training first
    files: list[Path]  # sources of the real motions


def plan_of(config: CorpusConfig) -> CorpusPlan:
    """The recordings of a configuration; nothing is made yet."""
    # Of any gender, as the bodies of real motions are not used.
    files = find_motion_files(config.amass, "any") if config.amass else []
    dyna, held_out = _dyna(config), [*_held_out(config), *_real(config, files)]
    order = [one.name for one in (*SUBJECTS[config.gender], *UNSEEN[config.gender])]
    held_out.sort(key=lambda recording: order.index(recording.subject.name))
    return CorpusPlan(dyna, held_out, files)


def _dyna(config: CorpusConfig) -> list[Recording]:
    """Sequences of the first subjects, by subject and then by motion.

    With every subject and every motion this is the full corpus, with exactly as many sequences
    and frames as the paper's; otherwise lengths are within a tenth of `mean_frames`.
    """
    motions, gender = config.motions, config.gender
    if not motions:
        raise DsnetError("no motions", f"some of {', '.join(DYNA_MOTIONS)}", "Pass --motions hips.")
    _check_names(motions, DYNA_MOTIONS)
    subjects = SUBJECTS[gender][: config.subjects]
    if subjects == SUBJECTS[gender] and set(motions) == set(DYNA_MOTIONS):
        pairs = itertools.product(subjects, DYNA_MOTIONS)
        pairs = [(one, kind) for one, kind in pairs if f"{one.name}_{kind}" not in _MISSING]
        lengths = _full_lengths(len(pairs), FULL_FRAMES[gender], config.seed)
        return [Recording(*pair, length) for pair, length in zip(pairs, lengths, strict=True)]
    pairs = itertools.product(subjects, motions)
    return [Recording(one, kind, _length(config, f"{one.name}_{kind}")) for one, kind in pairs]


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
    """Recordings that no stage uses before prediction, in the groups of `bridge.motion.splits`.

    Held-out kinds and the last kinds of training, each by subjects of training and by new ones. A
    subject that was trained on a kind does it in another style, as take 2.
    """
    _check_names(config.mosh_motions, HELD_OUT_MOTIONS)
    repeated = config.motions[max(0, len(config.motions) - config.retakes) :]
    recordings = []
    for row, kind in enumerate((*config.mosh_motions, *repeated)):
        frames = round(max(config.mosh_seconds, WHOLE_S.get(kind, 0.0)) * MOSH_FPS) + 1
        trained, new = _subjects_of_kind(config, row, config.crossing)
        number = 2 if kind in repeated else 1
        recordings += [Recording(subject, kind, frames, number) for subject in trained]
        recordings += [Recording(subject, kind, frames) for subject in new]
    return recordings


def _subjects_of_kind(
    config: CorpusConfig, row: int, crossing: Crossing
) -> tuple[tuple[Subject, ...], tuple[Subject, ...]]:
    """Subjects of training and new ones that do the held-out kind number `row`.

    `full`: the first two and all new ones. `rotating`: one of each, the next for the next kind.
    """
    trained, new = SUBJECTS[config.gender][: config.subjects], UNSEEN[config.gender]
    if crossing == "full":
        return trained[:_TRAINED_SUBJECTS], new
    return (trained[row % len(trained)],), (new[row % len(new)],)


def _check_names(motions: tuple[str, ...], allowed: Iterable[str]) -> None:
    if unknown := sorted(set(motions) - set(allowed)):
        remedy = did_you_mean(unknown[0], allowed, "Check their names.")
        raise DsnetError(f"motions {', '.join(unknown)}", f"among {', '.join(allowed)}", remedy)
    if repeated := sorted({motion for motion in motions if motions.count(motion) > 1}):
        received = f"motions {', '.join(repeated)} more than once"
        raise DsnetError(received, "each once", "Leave out the second.")


def _real(config: CorpusConfig, files: Iterable[Path]) -> list[Recording]:
    """Each real motion by one subject of training and one new one, in rotation.

    A motion with a cut is used up to it, as a jump would hit the simulated tissue. Motions shorter
    than a second are left out, and implausible ones are used as they are, with a line on stderr.
    Names of motions contain the rate if it is an option, and how they are smoothed.
    """
    recordings: list[Recording] = []
    smooth_hz = config.amass_smooth_hz
    for row, (path, kind) in enumerate(_kinds(files)):
        stored = read_motion_file(path)
        fps = config.amass_fps or stored.fps
        if np.isnan(fps):
            notify(f"{path}: left out; it does not state its rate, pass --amass-fps")
            continue
        frames = min(len(stored.pose), int(config.amass_seconds * fps) + 1)
        first, *later = stored.frames(slice(frames)).pieces
        if later:
            frames = first.stop
            notify(f"{path}: used up to {frames / fps:.2f} s, as it jumps there")
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
        trained, new = _subjects_of_kind(config, row, "rotating")
        recordings += [
            Recording(subject, kind, frames, source=path, source_fps=fps, smooth_hz=smooth_hz)
            for subject in (*trained, *new)
        ]
    return recordings


def _kinds(files: Iterable[Path]) -> Iterator[tuple[Path, str]]:
    """Each file with its kind, `amass_<motion>` or `bvh_<motion>`, in letters, digits, underscores.

    Equal names get the suffixes `_2` and so on. If the motion is a number, the subject precedes it,
    as in CMU's `05_06`.
    """
    used: set[str] = set()
    for path in files:
        subject, motion = subject_and_motion(path)
        whole = f"{subject}_{motion}" if motion.isdecimal() else motion
        name = f"{format_of(path)}_" + re.sub(r"\W+", "_", whole)
        names = itertools.chain([name], (f"{name}_{number}" for number in itertools.count(2)))
        kind = next(one for one in names if one not in used)
        used.add(kind)
        yield path, kind
