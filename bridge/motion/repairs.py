"""Frames of a file that are the recording's fault, drawn anew from those around them, and told of.

A tracker that loses somebody repeats its last pose. A solver turns a joint the other way round, or
puts the root elsewhere, and some frames later has it back: taken for motion that is a blow to all
tissue, and taken for a cut its beginning anew.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from bridge.motion.cuts import repeated_frames
from bridge.motion.interpolation import curved, values_on_lines
from bridge.motion.motion import Motion
from bridge.motion.speeds import WHAT_MOVES, excess_speeds
from bridge.motion.theta import pack_theta, unpack_theta
from bridge.paper import N_JOINTS

_LONGEST_SPIKE_S, _LONGEST_SPIKE = 0.1, 4
"""A spike has at most as many frames, or so many where frames are far apart."""
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
            ends = too_fast[(too_fast > first) & (too_fast <= first + longest)]
            if first <= after or not len(ends):
                continue
            left = [_excess_without(pose, trans_m, fps, (first, end, what)) for end in ends]
            if min(left) <= 1:
                after = int(ends[int(np.argmin(left))])
                spikes.append((int(first), after, what))
    frames = {frame for first, last, _ in spikes for frame in range(first, last)}
    return sorted(spikes) if len(frames) <= _MOST_SPIKED * len(pose) else []


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
