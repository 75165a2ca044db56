"""Warnings about a motion that is used all the same, a line each.

Four faults of recordings are looked for. A *cut* (`bridge.motion.cuts`), where the motion is
another one. A *pop*: where a recording loses a marker, or its solver turns a limb the other way
round, a joint flips within some frames or the root leaps; tissue is hit by it and swings for half a
second. What comes back at once is a spike, which `bridge.motion.repairs` takes out. A *fall* that
no body falls: a file's rate is a number that somebody wrote, and at twice its rate a motion is four
times as violent; what gives it away is a jump. *Tremor*: at 15 Hz a millimetre that no eye sees is
nearly a gravity of acceleration; what moves a body is slower than 10 Hz but for moments, so the
median of what is faster measures the noise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.motion.motion import Motion
from bridge.motion.speeds import GRAVITY_M_S2, WHAT_MOVES, excess_speeds
from bridge.motion.theta import unpack_theta

MOST_TREMOR_MM = 0.45
"""Motions without noise stay below 0.2, ours and a real jumping jack; most of CMU's early
recordings are above it."""
TREMOR_FROM_HZ = 10.0
_FEWEST_FRAMES = 30
MOST_FALL_G = 2.5
"""The pelvis may fall faster than the body, whose arms and legs are thrown up meanwhile: 1.4 times
gravity in a real jumping jack, and 5.5 at twice its rate."""
_FALL_HALF_S = 0.05
_POPS_APART_S = 0.25
_LISTED = 5
_LYING, _STANDING = 0.3, 0.7
"""Shares of the vertical in the direction of a trunk."""
_FLYING_M = 2.0


def motion_warnings(
    motion: Motion,
    pieces: Sequence[slice] | None = None,
    rate_option: str = "--motion-fps",
    smooth_option: str = "--smooth-hz auto",
) -> list[str]:
    """What of the file was left out, where it jumps, and how it moves as nobody can.

    Parameters
    ----------
    pieces : frames that are looked at; all, between cuts, if None.
    rate_option : the option by which the user says the right frame rate.
    smooth_option : the one that leaves noise out.
    """
    source, fps, lines = motion.source, motion.fps, [*motion.notes]
    trans_m, pieces = motion.trans_m, pieces or motion.pieces
    if motion.rest_pose_frames:
        lines.append(
            f"{source}: the motion begins after frame {motion.rest_pose_frames} of the file; "
            "before it stands a pose from which nobody gets there so fast"
        )
    if posture := _posture(motion):
        lines.append(posture)
    if cuts := [f"{piece.start} ({piece.start / fps:.2f} s)" for piece in pieces[1:]]:
        lines.append(
            f"{source} jumps at frame {_first_of(cuts)} of its {fps:g} frames a second: "
            "the tissue starts anew there, from rest"
        )
    fall_g = max(steepest_fall_g(trans_m[piece, 1], fps) for piece in pieces)
    if fall_g > MOST_FALL_G:
        lines.append(
            f"{source} falls with {fall_g:.1f} times gravity at its {motion.source_fps:g} "
            f"frames a second, where one of some {motion.source_fps / np.sqrt(fall_g):.0f} would "
            f"fit: if it is wrong, {rate_option} says the right one"
        )
    # At a wrong rate everything trembles and leaps; what `auto` leaves is motion.
    most_mm = 0.0
    if fall_g <= MOST_FALL_G and motion.smooth_hz != "auto":
        most_mm = max(tremor_mm(trans_m[piece], fps) for piece in pieces)
    pops = find_pops(motion, pieces)
    if max(fall_g / MOST_FALL_G, most_mm / MOST_TREMOR_MM) <= 1 and "root" not in pops.values():
        pops |= _leaps(motion, pieces)
    if named := [f"{name} at {frame / fps:.2f} s" for frame, name in sorted(pops.items())]:
        lines.append(
            f"{source} moves faster than anybody can: {_first_of(named)}: "
            "if it is a fault of the recording, smooth it there, for it throws the tissue"
        )
    if most_mm > MOST_TREMOR_MM:
        lines.append(
            f"{source} trembles by {most_mm:.1f} mm above {TREMOR_FROM_HZ:g} Hz, as noisy "
            f"recordings do, and shakes the tissue: {smooth_option} leaves that out"
        )
    return lines


def _posture(motion: Motion) -> str | None:
    """Of a body that lies, hangs or flies for most of a motion, y up: where its vertical may be
    another one."""
    height_m = motion.trans_m[:, 1]
    above_m = float(np.median(height_m - height_m.min()))
    posture = None
    if _uprightness(motion.pose) < _LYING:
        posture = "hangs head down" if is_head_down(motion.pose) else "lies or bends down"
    elif above_m > _FLYING_M:
        posture = f"is {above_m:.1f} m above its lowest place"
    if posture is None:
        return None
    return f"{motion.source} {posture} for most of it: if it should not, --up says its vertical"


def is_head_down(pose: NDArray[np.floating]) -> bool:
    """Whether a body is head down for most of a motion's pose (T, 22, 3), y up."""
    return _uprightness(pose) < -_STANDING


def _uprightness(pose: NDArray[np.floating]) -> float:
    trunk = Rotation.from_rotvec(pose[:, 0]).apply([0.0, 1.0, 0.0])
    return float(np.median(trunk[:, 1]))


def tremor_mm(trans_m: NDArray[np.floating], fps: float) -> float:
    """Median size of what is faster than 10 Hz in a path (T, 3), metres; 0 of half a second."""
    if len(trans_m) < _FEWEST_FRAMES or fps <= 2 * TREMOR_FROM_HZ:
        return 0.0
    # A Butterworth filter of second order, forwards and backwards. By its spectrum, as SciPy's
    # filters take longer to load than a short motion to predict.
    padded = min(round(fps), len(trans_m) - 1)
    path_m = np.pad(trans_m, ((padded, padded), (0, 0)), mode="reflect", reflect_type="odd")
    slow = np.tan(np.pi * TREMOR_FROM_HZ / fps)
    pace = np.tan(np.pi * np.fft.rfftfreq(len(path_m)))
    share = pace**4 / (slow**4 + pace**4)
    fast_m = np.fft.irfft(share[:, None] * np.fft.rfft(path_m, axis=0), len(path_m), axis=0)
    fast_m = fast_m[padded : padded + len(trans_m)]
    return 1e3 * float(np.median(np.linalg.norm(fast_m, axis=1)))


def steepest_fall_g(height_m: NDArray, fps: float) -> float:
    """Largest downward acceleration of a height (T,), in units of gravity; 0 if there is none."""
    fall_g, lasts, _ = _falls(height_m, fps)
    return float(fall_g[lasts].max(initial=0.0))


def _falls(
    height_m: NDArray, fps: float
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.intp]]:
    """Downward accelerations of a height (T,), in units of gravity, whether each lasts, and where.

    Each is the mean over a tenth of a second, weighted by a triangle of half its width h:
    -(y(t - h) - 2 y(t) + y(t + h)) / h^2. So an error of a millimetre makes no more than 0.2. Who
    falls does so all that time: where the median from frame to frame is less than half of it, the
    height leaps.
    """
    half = max(1, round(_FALL_HALF_S * fps))
    if len(height_m) <= 2 * half:
        return np.zeros(0), np.zeros(0, bool), np.zeros(0, np.intp)
    before, now, after = height_m[: -2 * half], height_m[half:-half], height_m[2 * half :]
    mean = (2 * now - before - after) / half**2
    each = sliding_window_view(-np.diff(height_m, 2), 2 * half - 1)
    lasts = np.median(each, axis=1) >= mean / 2
    return mean * fps**2 / GRAVITY_M_S2, lasts, half + np.arange(len(mean))


def find_pops(motion: Motion, pieces: Sequence[slice]) -> dict[int, str]:
    """The first frame of each pop, and what moves there: a joint's name, or `root`.

    Frames less than a quarter of a second apart are one pop; `pieces` are those between cuts.
    """
    pops: dict[int, str] = {}
    for piece in pieces:
        pose, trans_m = unpack_theta(np.asarray(motion.theta[piece], np.float64))
        excess = excess_speeds(pose, trans_m, motion.fps)
        for frame in _first_of_each(np.flatnonzero((excess > 1).any(axis=1)), motion.fps):
            pops[piece.start + frame] = WHAT_MOVES[int(excess[frame].argmax())]
    return pops


def _leaps(motion: Motion, pieces: Sequence[slice]) -> dict[int, str]:
    """The same of a root that is lifted or dropped within some frames, as nobody falls."""
    leaps: dict[int, str] = {}
    for piece in pieces:
        fall_g, lasts, at = _falls(motion.trans_m[piece, 1], motion.fps)
        too_fast = at[(fall_g > MOST_FALL_G) & ~lasts]
        leaps |= {piece.start + n: "root" for n in _first_of_each(too_fast, motion.fps)}
    return leaps


def _first_of_each(frames: NDArray[np.intp], fps: float) -> list[int]:
    """The first of those that are less than a quarter of a second apart."""
    far = np.diff(frames, prepend=-np.inf) > _POPS_APART_S * fps
    return frames[far].tolist()


def _first_of(named: Sequence[str]) -> str:
    more = f" and {len(named) - _LISTED} more" if len(named) > _LISTED else ""
    return ", ".join(named[:_LISTED]) + more
