"""Real motions as extra test takes: synthetic people follow them with simulated tissue."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from functools import partial
from itertools import count
from pathlib import Path

from bridge.motion.cuts import find_cuts
from bridge.motion.motion_checks import motion_warnings
from bridge.motion.readers import (
    find_motion_files,
    format_of,
    read_motion_file,
    subject_and_motion,
)
from bridge.motion.resampling import load_motion_file, resampled_frames
from bridge.motion.smoothing import SmoothHz
from bridge.runs.processes import notify
from torch_align_ae.corpus.sequences import Take, performers
from torch_align_ae.corpus.subjects import Gender

_SHORTEST_S = 1.0


def find_real_motions(folder: Path | None) -> list[Path]:
    """The motions below `folder`, of bodies of any gender: no body of theirs is used.

    Raises
    ------
    DsnetError
        If the folder is none, holds no motion, or holds an `.npz` that cannot be read.
    """
    return [] if folder is None else find_motion_files(folder, "any")


def real_takes(
    files: Iterable[Path],
    gender: Gender,
    subjects: int,
    longest_s: float,
    source_fps: float | None = None,
    smooth_hz: SmoothHz | None = None,
) -> list[Take]:
    """Each motion done by one known and one new person, the next ones for the next motion.

    Of a long motion the first `longest_s` are used, of one that jumps what comes before it does,
    for to simulated tissue a jump is a blow. What is shorter than a second is left out, and what
    moves as nobody can is taken as it is, each with a line on stderr. `source_fps` is the rate of
    all files, where what they say of themselves is wrong; what is faster than `smooth_hz` is left
    out; their names then have it.

    Raises
    ------
    DsnetError
        If a file is no motion.
    """
    takes: list[Take] = []
    for row, (path, kind) in enumerate(_kinds(files)):
        stored = read_motion_file(path)
        fps = source_fps or stored.fps
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
        name = kind if source_fps is None else f"{kind}_at_{source_fps:g}_hz"
        name += _suffix(smooth_hz)
        known, new = performers(gender, subjects, row, "rotating")
        takes += [
            Take(person, name, frames, source=path, source_fps=fps, smooth_hz=smooth_hz)
            for person in (*known, *new)
        ]
    return takes


def _suffix(smooth_hz: SmoothHz | None) -> str:
    if smooth_hz is None:
        return ""
    return "_smoothed" if smooth_hz == "auto" else f"_smoothed_{smooth_hz:g}_hz"


def _kinds(files: Iterable[Path]) -> Iterator[tuple[Path, str]]:
    """`amass_<motion>` or `bvh_<motion>` of each, in letters, digits and underscores, a second one
    of a name `_2`; a motion that is but a number has its person's before it, as CMU's `05_06`."""
    taken: set[str] = set()
    numbers: defaultdict[str, Iterator[int]] = defaultdict(partial(count, 1))
    for path in files:
        subject, motion = subject_and_motion(path)
        whole = f"{subject}_{motion}" if motion.isdecimal() else motion
        name = f"{format_of(path)}_" + re.sub(r"\W+", "_", whole)
        names = (name if number == 1 else f"{name}_{number}" for number in numbers[name])
        kind = next(one for one in names if one not in taken)
        taken.add(kind)
        yield path, kind
