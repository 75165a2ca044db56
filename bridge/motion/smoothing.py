"""A recording without its tremor: what changes faster than people move is mostly noise.

Accelerations drive tissue; in them noise grows with the square of its frequency, and tissue swings
at 5 to 15 Hz. Biomechanics filters recordings of markers at 6 to 12 Hz for the same reason
(Winter, *Biomechanics and Motor Control of Human Movement*): by a Butterworth filter of second
order, once forwards and once backwards, so that nothing is late.

What cutoff suits differs from moment to moment, and `auto` seeks it. What moves a trunk gets less
with frequency, and the noise of a recording, read as acceleration, grows with frequency squared.
Between them lies a valley. A dancer's is at 5 Hz, that of somebody who lands from a jump beyond 15:
no one cutoff suits both (docs/prediction.md).

Frames that come one by one cannot wait so long: `StreamSmoother` looks three ahead.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.errors import DsnetError
from bridge.motion.cuts import is_cut
from bridge.motion.motion import Motion, SmoothHz
from bridge.motion.theta import pack_theta, unpack_theta

LEAST_HZ = 0.1
"""Slower, nothing of a motion is left, and a filter's numbers fall below what floats can hold."""
_PADDED_FRAMES = 9
_BANK_HZ = (4, 5, 6, 7, 8, 10, 12, 14, 17, 20, 24)
_TRUNK = (0, 1, 2, 3, 6, 9)
"""Pelvis, hips and spine, which carry most of the flesh."""
_LEVER_M = 0.2
"""How far from these joints it is: what a turn amounts to."""
_WINDOW_S, _HOP_S = 1.0, 0.25
_SLOWEST_HZ, _FASTEST_HZ = 3.0, 20.0
_SMOOTHED_HZ = 1.5
"""Half of the width over which a spectrum is averaged before its valley is sought."""
_CUTOFF_OF_VALLEY = 1.4
"""At its cutoff a filter has halved what it is given, at the valley motion is still all there is.
Chosen on training motions of this project's law (docs/prediction.md)."""
_FEWEST_FRAMES = 16
_STREAM_S, _STREAM_FRAMES = 0.7, 120
"""Of a stream's window, and the most frames of it: more of them add little and cost much."""
_STREAM_SHARE = 0.45
"""Of a rate, cutoffs are below it."""
_TRUNK_VALUES = [*(4 * joint + n for joint in _TRUNK for n in range(4)), -3, -2, -1]
_TRUNK_M = np.array([2 * _LEVER_M] * 4 * len(_TRUNK) + [1.0] * 3)
"""What a change by 1 of these amounts to."""
_BENT = 3
"""The order of differences of which a smooth curve has few."""
_RECENT_S, _SURE, _NO_ERROR_M2 = 0.4, 2.0, 1e-14
"""How long errors count, how sharply the least is preferred, and what is none."""


def smoothed(motion: Motion, smooth_hz: SmoothHz) -> Motion:
    """The motion without what is faster than a cutoff, or `auto`, piece by piece between cuts.

    Rotations are filtered as quaternions, which are made unit quaternions again.
    """
    if smooth_hz != "auto" and not LEAST_HZ <= smooth_hz < motion.fps / 2:
        raise DsnetError(
            f"a motion of {motion.fps:g} frames a second, smoothed at {smooth_hz:g} Hz",
            f"{LEAST_HZ:g} or more and less than {motion.fps / 2:g} Hz, half its rate",
            "Pass auto, or 6 to 12.",
        )
    pose, trans_m = motion.all_joints, motion.trans_m.copy()
    for piece in motion.pieces:
        if smooth_hz == "auto":
            cutoff_hz = noise_cutoff_hz(pose[piece], trans_m[piece], motion.fps)
        else:
            cutoff_hz = smooth_hz
        turns = _calmed(continuous_quaternions(pose[piece]), cutoff_hz, motion.fps)
        rotations = Rotation.from_quat(turns.reshape(-1, 4))
        pose[piece] = rotations.as_rotvec().reshape(pose[piece].shape)
        trans_m[piece] = _calmed(trans_m[piece], cutoff_hz, motion.fps)
    return motion.posed(pose, trans_m, smooth_hz=smooth_hz)


def no_noise_hz(fps: float) -> float:
    """The cutoff that says that no noise was found."""
    return _CUTOFF_OF_VALLEY * _fastest_hz(fps)


def noise_cutoff_hz(pose: NDArray, trans_m: NDArray, fps: float) -> NDArray[np.float64]:
    """(T,) cutoff that suits each frame of pose (T, J, 3), axis-angle, and trans (T, 3), metres."""
    if len(pose) < _FEWEST_FRAMES or _fastest_hz(fps) < 2 * _SLOWEST_HZ:
        return np.full(len(pose), no_noise_hz(fps))
    # Every motion's reader imports this module, and few smooth: SciPy's filters load slowly.
    from scipy.ndimage import uniform_filter1d
    from scipy.signal import ShortTimeFFT
    from scipy.signal.windows import hann

    moved = _accelerations(pose, trans_m, fps)
    size = max(round(_WINDOW_S * fps), _FEWEST_FRAMES)
    window = hann(min(size, len(moved)), sym=False)
    transform = ShortTimeFFT(window, max(round(_HOP_S * fps), 1), fps, mfft=2 * size)
    spectra = transform.spectrogram(moved, axis=0, padding="even").sum(axis=1)  # (f, times)
    averaged = uniform_filter1d(
        np.log(spectra + np.finfo(float).tiny),
        2 * round(_SMOOTHED_HZ / transform.delta_f) + 1,
        axis=0,
        mode="nearest",
    )
    sought = (transform.f >= _SLOWEST_HZ) & (transform.f <= _fastest_hz(fps))
    valleys_hz = transform.f[sought][averaged[sought].argmin(axis=0)]
    frames = 1 + transform.t(len(moved)) * fps  # the first acceleration is the second frame's
    between = np.interp(np.arange(len(pose)), frames, np.log(valleys_hz))
    return _CUTOFF_OF_VALLEY * np.exp(between)


class StreamSmoother:
    """`auto` for poses that come one by one, each answered three frames later.

    In a window that ends three frames after the one that is answered lies, for each cutoff, the
    curve of least third differences: what a Kalman smoother of constant acceleration finds. These
    are mixed by how well each foretells frames of the trunk that are left out of it, the newest
    most. No curve goes on over a cut.
    """

    look_ahead = 3

    def __init__(self, fps: float) -> None:
        self._fps = fps
        size = min(max(round(_STREAM_S * fps), _FEWEST_FRAMES), _STREAM_FRAMES)
        self._newest: deque[tuple[NDArray, NDArray, int]] = deque(maxlen=size)
        """Theta (69,), quaternions and place (91,), and between which cuts it lies."""
        self._owed = 0

    def push(self, theta: NDArray) -> NDArray[np.floating] | None:
        """The pose (69,) that was given three frames ago; the first one at once, as it is, and then
        none until three have come after the next."""
        is_first, piece = not self._newest, 0
        turned = Rotation.from_rotvec(unpack_theta(theta)[0]).as_quat()
        if not is_first:
            last, values, piece = self._newest[-1]
            piece += int(is_cut(last[None], theta[None])[0])
            before = values[:-3].reshape(turned.shape)  # q and -q are one rotation
            turned *= np.where((turned * before).sum(axis=1, keepdims=True) < 0, -1.0, 1.0)
        self._newest.append((theta, np.concatenate([turned.ravel(), theta[-3:]]), piece))
        self._owed += not is_first
        if is_first:
            return theta
        return self._next() if self._owed > self.look_ahead else None

    def finish(self) -> Iterator[NDArray[np.floating]]:
        """The poses that no push has answered: nothing comes after them."""
        while self._owed:
            yield self._next()

    def _next(self) -> NDArray[np.floating]:
        poses, values, pieces = zip(*self._newest, strict=True)
        at = len(poses) - self._owed
        self._owed -= 1
        rows = np.flatnonzero(np.array(pieces) == pieces[at])
        if len(rows) <= _BENT:
            return poses[at]
        curves, newest = _curves_through(len(rows), self._fps), values[-1]
        window = np.array(values)[rows] - newest  # small numbers lose less
        trunk = window[:, _TRUNK_VALUES] * _TRUNK_M
        fitted = 1 - np.diagonal(curves, axis1=1, axis2=2)
        missed_m = (trunk - curves @ trunk) / fitted[..., None]  # (cutoffs, frames, values)
        recent = np.exp(-np.arange(len(rows))[::-1] / (_RECENT_S * self._fps))
        error_m2 = (missed_m**2).sum(axis=-1) @ recent / recent.sum() + _NO_ERROR_M2
        shares = (error_m2 / error_m2.min()) ** (-_SURE * min(len(rows), _RECENT_S * self._fps))
        smooth = newest + shares / shares.sum() @ curves[:, at - rows[0]] @ window
        pose = Rotation.from_quat(smooth[:-3].reshape(-1, 4)).as_rotvec()
        both = np.stack([unpack_theta(poses[at])[0], pose])
        return pack_theta(continuous_rotations(both)[1], smooth[-3:])


@lru_cache(maxsize=256)
def _curves_through(count: int, fps: float) -> NDArray[np.floating]:
    """(K, N, N) by a bank's cutoffs: what makes of N values those of a smooth curve."""
    hz = np.array([hz for hz in _BANK_HZ if hz < _STREAM_SHARE * fps])
    bent = np.diff(np.eye(count), _BENT, axis=0)
    stiffness = (2 * np.sin(np.pi * hz / fps)) ** (-2 * _BENT)
    curves = np.linalg.inv(np.eye(count) + stiffness[:, None, None] * (bent.T @ bent))
    return curves.astype(np.float64)


def _fastest_hz(fps: float) -> float:
    return min(_FASTEST_HZ, fps / 3)


def _accelerations(pose: NDArray, trans_m: NDArray, fps: float) -> NDArray[np.float64]:
    """(T - 2, n) in m/s^2: the root's, and those of the trunk's turns at their lever."""
    turned = Rotation.from_rotvec(pose[:, _TRUNK].reshape(-1, 3))
    turned = turned.as_matrix().reshape(len(pose), len(_TRUNK), 3, 3)
    steps = Rotation.from_matrix(
        (turned[:-1].swapaxes(-1, -2) @ turned[1:]).reshape(-1, 3, 3)
    ).as_rotvec()
    rates = fps * steps.reshape(len(pose) - 1, -1)
    turning = _LEVER_M * fps * np.diff(rates, axis=0)
    return np.concatenate([fps**2 * np.diff(trans_m, 2, axis=0), turning], axis=1)


def _calmed(
    values: NDArray[np.floating], cutoff_hz: float | NDArray[np.floating], fps: float
) -> NDArray[np.floating]:
    """Values (T, ...) at one cutoff, or each at its own (T,): between those of the two next to it
    in a bank of filters, in proportion to the logarithm of frequency. The last lets all pass."""
    if np.ndim(cutoff_hz) == 0:
        return _low_passed(values, float(cutoff_hz), fps)
    most_hz = no_noise_hz(fps)
    bank_hz = [*(hz for hz in _BANK_HZ if hz < most_hz), most_hz]
    place = np.interp(np.log(cutoff_hz), np.log(bank_hz), np.arange(len(bank_hz)))
    mixed = np.zeros_like(values)
    for number, hz in enumerate(bank_hz):
        share = np.clip(1 - np.abs(place - number), 0, 1)
        if share.any():
            passed = values if hz == most_hz else _low_passed(values, hz, fps)
            mixed += share.reshape(-1, *[1] * (values.ndim - 1)) * passed
    return mixed


def _low_passed(values: NDArray[np.floating], hz: float, fps: float) -> NDArray[np.floating]:
    if len(values) < 2:
        return values
    from scipy.signal import butter, sosfiltfilt  # as above

    sections = np.asarray(butter(2, hz, fs=fps, output="sos"))
    padded = min(_PADDED_FRAMES, len(values) - 1)
    return np.asarray(sosfiltfilt(sections, values, axis=0, padlen=padded))


def continuous_quaternions(pose: NDArray[np.floating]) -> NDArray[np.floating]:
    """(T, J, 4) of rotations (T, J, 3); of q and -q, the one nearer to the frame before."""
    turns = Rotation.from_rotvec(pose.reshape(-1, 3)).as_quat().reshape(*pose.shape[:2], 4)
    opposite = (turns[1:] * turns[:-1]).sum(axis=-1) < 0
    signs = np.where(np.cumsum(opposite, axis=0) % 2 == 1, -1.0, 1.0)
    turns[1:] *= signs[..., None]
    return turns


def continuous_rotations(pose: NDArray[np.floating]) -> NDArray[np.floating]:
    """Of the axis-angle vectors (T, J, 3) of each rotation, the one nearest to the frame before."""
    angle = np.linalg.norm(pose, axis=-1, keepdims=True)
    axis = np.divide(pose, angle, out=np.zeros_like(pose), where=angle > 1e-9)
    result = pose.copy()
    for frame in range(1, len(pose)):
        along = (result[frame - 1] * axis[frame]).sum(axis=-1, keepdims=True)
        turns = np.round((along - angle[frame]) / (2 * np.pi))
        result[frame] += 2 * np.pi * turns * axis[frame]
    return result
