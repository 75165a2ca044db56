"""Where in its spectrum a recording ends being motion and begins being noise, moment by moment.

What moves a trunk gets less with frequency, and the noise of a recording, read as acceleration,
grows with frequency squared. Between them lies a valley. A dancer's is at 5 Hz, that of somebody
who lands from a jump beyond 15: no one cutoff suits both (docs/prediction.md).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.signal import ShortTimeFFT
from scipy.signal.windows import hann
from scipy.spatial.transform import Rotation

_TRUNK = (0, 1, 2, 3, 6, 9)
"""Pelvis, hips and spine, on which most of the flesh hangs."""
_LEVER_M = 0.2
"""How far from these joints it is: what a turn amounts to."""
_WINDOW_S, _HOP_S = 1.0, 0.25
_SLOWEST_HZ, _FASTEST_HZ = 3.0, 20.0
_SMOOTHED_HZ = 1.5
"""Half of the width over which a spectrum is averaged before its valley is sought."""
_CUTOFF_OF_VALLEY = 1.4
"""At its cutoff a filter has halved what it is given, at the valley motion is still all there is.
Chosen on training motions of the own law (docs/prediction.md)."""
_FEWEST_FRAMES = 16


def most_cutoff_hz(fps: float) -> float:
    """The cutoff that says that no noise was found."""
    return _CUTOFF_OF_VALLEY * _fastest_hz(fps)


def _fastest_hz(fps: float) -> float:
    return min(_FASTEST_HZ, fps / 3)


def cutoffs_hz(pose: NDArray, trans_m: NDArray, fps: float) -> NDArray[np.float64]:
    """(T,) cutoff that suits each frame of pose (T, J, 3), axis-angle, and trans (T, 3), metres."""
    if len(pose) < _FEWEST_FRAMES or _fastest_hz(fps) < 2 * _SLOWEST_HZ:
        return np.full(len(pose), most_cutoff_hz(fps))
    felt = _accelerations(pose, trans_m, fps)
    size = max(round(_WINDOW_S * fps), _FEWEST_FRAMES)
    window = hann(min(size, len(felt)), sym=False)
    transform = ShortTimeFFT(window, max(round(_HOP_S * fps), 1), fps, mfft=2 * size)
    spectra = transform.spectrogram(felt, axis=0, padding="even").sum(axis=1)  # (f, times)
    averaged = uniform_filter1d(
        np.log(spectra + np.finfo(float).tiny),
        2 * round(_SMOOTHED_HZ / transform.delta_f) + 1,
        axis=0,
        mode="nearest",
    )
    sought = (transform.f >= _SLOWEST_HZ) & (transform.f <= _fastest_hz(fps))
    valleys_hz = transform.f[sought][averaged[sought].argmin(axis=0)]
    frames = 1 + transform.t(len(felt)) * fps  # the first acceleration is the second frame's
    between = np.interp(np.arange(len(pose)), frames, np.log(valleys_hz))
    return _CUTOFF_OF_VALLEY * np.exp(between)


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
