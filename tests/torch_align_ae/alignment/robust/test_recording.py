from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from torch_align_ae.alignment.robust.recording import (
    FrameWindow,
    MeshRecording,
    accelerations,
    noise_variance,
    shared_noise,
    spread_clips,
    windows,
)


def recording(frames: np.ndarray, fps: float = 60.0) -> MeshRecording:
    def read(start, stop):
        assert 0 <= start < stop <= len(frames)
        return frames[start:stop]

    return MeshRecording(read, len(frames), fps)


def planar(meshes: torch.Tensor) -> torch.Tensor:
    return meshes.transpose(1, 2)


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
    meshes, vertices, acceleration, jerk = recording(frames).moving(start, stop, planar)
    np.testing.assert_allclose(meshes, frames[start:stop])
    np.testing.assert_allclose(vertices, frames[start:stop].transpose(0, 2, 1))
    expected = np.zeros((stop - start, 3, 2))
    expected[:, 1, 0] = -9.81
    np.testing.assert_allclose(acceleration, expected, atol=1e-8)
    np.testing.assert_allclose(jerk, np.zeros_like(expected), atol=1e-6)


def test_jerk_is_the_change_of_the_acceleration():
    time_s = np.arange(20) / 60
    frames = np.zeros((20, 2, 3))
    frames[:, 1, 2] = 5 * time_s**3
    *_, jerk = recording(frames).moving(6, 12, planar)
    expected = np.zeros((6, 3, 2))
    expected[:, 2, 1] = 30
    np.testing.assert_allclose(jerk, expected, atol=1e-7)


@pytest.mark.parametrize("length", range(1, 8))
def test_short_sequences(length):
    frames, *seen = recording(falling(length)).moving(0, length, planar)
    assert frames.shape == (length, 2, 3)
    assert all(part.shape == (length, 3, 2) for part in seen)
    assert all(torch.isfinite(part).all() for part in seen)
    assert bool(seen[1].any()) == (length >= 3)


@given(st.integers(0, 10), st.integers(1, 11))
def test_parts_of_a_sequence_are_those_of_the_whole(start, count):
    frames = np.random.default_rng(0).normal(size=(11, 2, 3))
    stop = min(start + count, 11)
    _, *whole = recording(frames).moving(0, 11, planar)
    _, *part = recording(frames).moving(start, stop, planar)
    for ours, all_of_it in zip(part, whole, strict=True):
        np.testing.assert_array_equal(ours, all_of_it[start:stop])


def test_ends_take_their_neighbours_acceleration():
    frames = torch.randn(6, 2, 3, generator=torch.Generator().manual_seed(0))
    found = accelerations(frames, 60.0)
    torch.testing.assert_close(found[0], found[1])
    torch.testing.assert_close(found[-1], found[-2])
    torch.testing.assert_close(found[1], 3600 * (frames[2] - 2 * frames[1] + frames[0]))
    torch.testing.assert_close(found[2], 900 * (frames[4] - 2 * frames[2] + frames[0]))


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


@pytest.mark.parametrize("noise_m", [1e-4, 1e-3])
def test_noise_is_measured_beside_motion(noise_m):
    """All vertices swing together by centimetres, each with noise of its own."""
    time_s = torch.arange(40)[:, None, None] / 60
    moving = 0.05 * torch.sin(20 * time_s).expand(40, 3, 60)
    noise = noise_m * torch.randn(40, 3, 60, generator=torch.Generator().manual_seed(0))
    around = torch.full((60, 60), 1 / 60)
    assert noise_variance(moving, around) < 1e-14
    found = noise_variance(moving + noise, around)
    np.testing.assert_allclose(found, noise_m**2, rtol=0.1)
    assert noise_variance(noise[:4], around) == 0


def test_shared_noise_is_what_noise_and_its_acceleration_have_in_common():
    noise = torch.randn(4000, 3, 5, generator=torch.Generator().manual_seed(0))
    common = -(noise * accelerations(noise, 60.0)).sum(1).mean()
    np.testing.assert_allclose(common, shared_noise(1.0, 60.0), rtol=0.02)
