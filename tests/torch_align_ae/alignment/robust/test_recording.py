from __future__ import annotations

import numpy as np
import pytest
import torch

from torch_align_ae.alignment.robust.recording import (
    FrameWindow,
    MeshRecording,
    spread_clips,
    windows,
)


def recording(frames: np.ndarray, fps: float = 60.0) -> MeshRecording:
    def read(start, stop):
        assert 0 <= start < stop <= len(frames)
        return frames[start:stop]

    return MeshRecording(read, len(frames), fps)


def falling(length: int) -> np.ndarray:
    """Two vertices, one in free fall, one moving steadily, at 60 fps."""
    time_s = np.arange(length) / 60
    frames = np.zeros((length, 2, 3))
    frames[:, 0, 1] = 1 - 9.81 / 2 * time_s**2
    frames[:, 1, 0] = 0.3 * time_s
    return frames


@pytest.mark.parametrize(("start", "stop"), [(0, 20), (0, 1), (19, 20), (5, 9), (0, 2), (18, 20)])
def test_accelerations_are_per_second_squared(start, stop):
    frames = falling(20)
    meshes, acceleration = recording(frames).meshes(start, stop)
    np.testing.assert_allclose(meshes, frames[start:stop])
    expected = np.zeros((stop - start, 2, 3))
    expected[:, 0, 1] = -9.81
    np.testing.assert_allclose(acceleration, expected, atol=1e-8)


@pytest.mark.parametrize("length", [1, 2, 3])
def test_short_sequences(length):
    meshes, acceleration = recording(falling(length)).meshes(0, length)
    assert meshes.shape == acceleration.shape == (length, 2, 3)
    assert torch.isfinite(acceleration).all()
    assert bool(acceleration.any()) == (length == 3)


def test_ends_take_their_neighbours_acceleration():
    frames = np.random.default_rng(0).normal(size=(6, 2, 3))
    _, acceleration = recording(frames).meshes(0, 6)
    torch.testing.assert_close(acceleration[0], acceleration[1])
    torch.testing.assert_close(acceleration[-1], acceleration[-2])


def test_windows_cover_every_frame_once():
    assert windows([5, 2], 2) == [
        FrameWindow(0, 0, 2),
        FrameWindow(0, 2, 4),
        FrameWindow(0, 4, 5),
        FrameWindow(1, 0, 2),
    ]


def test_clips_are_spread_over_all_recordings():
    own = [recording(falling(length)) for length in (100, 3, 60, 40)]
    clips = list(spread_clips(own, 96))
    assert sum(stop - start for _, start, stop in clips) <= 96
    assert all(0 <= start < stop <= clip.length for clip, start, stop in clips)
    assert {clip.length for clip, *_ in clips} >= {100, 60, 40}


def test_a_lone_frame_is_a_clip():
    assert [(start, stop) for _, start, stop in spread_clips([recording(falling(1))], 96)] == [
        (0, 1)
    ]
