"""Frames of a file that are the recording's fault, drawn anew from those around them, and told of.

A tracker that loses somebody repeats its last pose, or leaves the frames out. A solver turns a
joint the other way round, or puts the root elsewhere, and some frames later has it back: taken for
motion that is a blow to all tissue, and taken for a cut its beginning anew.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from bridge.errors import DsnetError
from bridge.motion.cuts import repeated_frames, turns_rad
from bridge.motion.interpolation import curved, values_on_lines
from bridge.motion.motion import MOST_FRAMES, Motion
from bridge.motion.speeds import WHAT_MOVES, excess_speeds
from bridge.motion.theta import pack_theta, unpack_theta
from bridge.paper import N_JOINTS

_LONGEST_GAP_S = 0.5
"""What is drawn through longer ones is nobody's motion."""
_LONGEST_SPIKE_S, _LONGEST_SPIKE = 0.1, 4
"""A spike has at most as many frames, or so many where frames are far apart."""
_BACK = 0.5
"""Of the way that it was away."""
_LEAST_ROOT_M = 0.03
"""Less is noise, which is smoothed."""
_MOST_SPIKED = 0.05
"""Where more of a motion's frames are too fast, its rate is wrong, or everything else."""
_LISTED = 5


def without_repeats(motion: Motion) -> Motion:
    """The motion with repeated frames interpolated between the others, and a note of it."""
    pieces, count = motion.pieces, len(motion.theta)
    parts = [repeated_frames(motion.theta[piece], motion.fps) for piece in pieces]
    repeated, at_s = np.concatenate(parts), np.arange(count) / motion.fps
    if not repeated.any():
        return motion
    pose, line = motion.all_joints.copy(), values_on_lines(motion)
    for piece in pieces:
        again, others = (piece.start + np.flatnonzero(repeated[piece] == one) for one in (1, 0))
        if len(again):
            pose[again], line[again] = curved(pose[others], line[others], at_s[others], at_s[again])
    note = (
        f"{motion.source} repeats {repeated.sum()} of its {count} frames while the body moves, "
        f"first at {at_s[repeated][0]:.2f} s: they are interpolated"
    )
    dmpls = None if motion.dmpls is None else line[:, 3:]
    return motion.posed(pose, line[:, :3], dmpls=dmpls, notes=(*motion.notes, note))


def without_gaps(motion: Motion) -> Motion:
    """The motion with the frames that its `frame_numbers` leave out interpolated, so that it takes
    the time that it took, and a note of it. Of one with longer gaps, or with a cut in one, the
    longest piece between them."""
    if (given := motion.frame_numbers) is None:
        return motion
    if given[-1] - given[0] >= MOST_FRAMES:
        raise DsnetError(
            f"{motion.source}, whose frames are numbered {given[0]} to {given[-1]}",
            f"at most {MOST_FRAMES}, some of which may be missing",
            "Correct their numbers, or cut it into several files.",
        )
    missing, cuts = np.diff(given) - 1, np.array(motion.cuts, np.intp)
    ends = missing > _LONGEST_GAP_S * motion.fps
    ends[cuts - 1] |= missing[cuts - 1] > 0
    pieces = pairwise([0, *(np.flatnonzero(ends) + 1).tolist(), len(given)])
    first, last = max(pieces, key=lambda piece: given[piece[1] - 1] - given[piece[0]])
    kept, numbers = motion.frames(slice(first, last)), given[first:last]
    pose, line, drawn = kept.all_joints, values_on_lines(kept), []
    for piece in kept.pieces:
        own = numbers[piece]
        all_of_them = np.arange(own[0], own[-1] + 1)
        values = pose[piece], line[piece]
        is_whole = len(own) == len(all_of_them)
        drawn.append(values if is_whole else curved(*values, own, all_of_them))
    begins = np.cumsum([len(part) for part, _ in drawn])[:-1]
    pose, line = (np.concatenate(parts) for parts in zip(*drawn, strict=True))
    how = ["they are interpolated"] if len(pose) > len(numbers) else []
    if ends.any():
        span = f"{numbers[0]} to {numbers[-1]}"
        how = [f"frames {span} alone, the longest piece between long gaps, are read", *how]
    dmpls = None if motion.dmpls is None else line[:, 3:]
    return kept.posed(
        pose,
        line[:, :3],
        dmpls=dmpls,
        cuts=tuple(begins.tolist()),
        frame_numbers=None,
        notes=(*motion.notes, f"{motion.source} has no frames {_missing(given)}: {', '.join(how)}"),
    )


def _missing(numbers: NDArray[np.intp]) -> str:
    """Numbers between growing ones, in words."""
    gaps = [(one + 1, two - 1) for one, two in pairwise(numbers.tolist()) if two > one + 1]
    words = [str(one) if one == last else f"{one} to {last}" for one, last in gaps]
    more = sum(last - one + 1 for one, last in gaps[_LISTED:])
    return ", ".join(words[:_LISTED]) + (f" and {more} more" if more else "")


def without_spikes(motion: Motion) -> Motion:
    """The motion without what leaves faster than anybody can and is back some frames later: the
    joint's turns, or the root's places, go on between the frames around it, and a note tells."""
    pose, trans_m = unpack_theta(np.asarray(motion.theta, np.float64))
    found = find_spikes(pose, trans_m, motion.fps)
    if not found:
        return motion
    pose, trans_m = pose.copy(), trans_m.copy()
    for first, last, what in found:
        _bridge(pose, trans_m, first, last, what)
    named = [f"{WHAT_MOVES[what]} at {first / motion.fps:.2f} s" for first, _, what in found]
    more = f" and {len(named) - _LISTED} more" if len(named) > _LISTED else ""
    note = (
        f"{motion.source} leaps faster than anybody can and is back within some frames: "
        f"{', '.join(named[:_LISTED])}{more}: interpolated between the frames around it"
    )
    return replace(motion, theta=pack_theta(pose, trans_m), notes=(*motion.notes, note))


def find_spikes(pose: NDArray, trans_m: NDArray, fps: float) -> list[tuple[int, int, int]]:
    """Of a pose (T, 22, 3) and places (T, 3), metres: first frame of each spike, the first after
    it, and what moves (of `WHAT_MOVES`), in order of time.

    Between the frames around a spike lies motion that anybody can do; of several that lie so, those
    between which least is done.
    """
    excess = excess_speeds(pose, trans_m, fps)
    longest = max(_LONGEST_SPIKE, round(_LONGEST_SPIKE_S * fps))
    spikes = []
    for what in np.flatnonzero((excess > 1).any(axis=0)).tolist():
        after = 0
        too_fast = np.flatnonzero(excess[:, what] > 1)
        for first in too_fast:
            ends = [
                end
                for end in too_fast[(too_fast > first) & (too_fast <= first + longest)]
                if _comes_back(pose, trans_m, first, end, what)
            ]
            if first <= after or not ends:
                continue
            left = [_excess_without(pose, trans_m, fps, (first, end, what)) for end in ends]
            if min(left) <= 1:
                after = int(ends[int(np.argmin(left))])
                spikes.append((int(first), after, what))
    frames = {frame for first, last, _ in spikes for frame in range(first, last)}
    return sorted(spikes) if len(frames) <= _MOST_SPIKED * len(pose) else []


def _comes_back(pose: NDArray, trans_m: NDArray, first: int, last: int, what: int) -> bool:
    """Whether what moves ends nearer to where it would have been anyway than it was on the way: a
    joint where it was, the root as fast as before."""
    frames = np.arange(first, last + 1)
    if what < N_JOINTS:
        before = np.tile(pose[first - 1, what], (len(frames), 1, 1))
        away = turns_rad(before, pose[frames, what][:, None])[:, 0]
    else:
        step_m = trans_m[first - 1] - trans_m[max(first - 2, 0)]
        straight_m = trans_m[first - 1] + (frames - first + 1)[:, None] * step_m
        away = np.linalg.norm(trans_m[frames] - straight_m, axis=1)
        if away[:-1].max() < _LEAST_ROOT_M:
            return False
    return bool(away[-1] <= _BACK * away[:-1].max())


def _excess_without(
    pose: NDArray, trans_m: NDArray, fps: float, spike: tuple[int, int, int]
) -> float:
    """How fast that is around a spike which is bridged, in parts of what people reach."""
    first, last, what = spike
    near = slice(max(first - 2, 0), last + 2)
    pose, trans_m = pose[near].copy(), trans_m[near].copy()
    first, last = first - near.start, last - near.start
    _bridge(pose, trans_m, first, last, what)
    return float(excess_speeds(pose, trans_m, fps)[: last + 1, what].max())


def _bridge(pose: NDArray, trans_m: NDArray, first: int, last: int, what: int) -> None:
    """Draw frames `first` to `last` of what moves anew: evenly from the one before to `last`."""
    inner = np.arange(first, last)
    ends = [first - 1, last]
    if what < N_JOINTS:
        pose[inner, what] = Slerp(ends, Rotation.from_rotvec(pose[ends, what]))(inner).as_rotvec()
    else:
        share = (inner - ends[0])[:, None] / (last - ends[0])
        trans_m[inner] = trans_m[ends[0]] + share * (trans_m[last] - trans_m[ends[0]])
