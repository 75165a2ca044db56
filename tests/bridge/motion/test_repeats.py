"""Frames that a tracker or a slower camera repeats are found, interpolated, and told of."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bridge.motion import load_motion
from bridge.motion.cuts import repeated_frames
from bridge.motion.readers.amass import sample_path
from tests.forged.amass import save

FPS = 60.0
FRAMES = np.arange(120)


def lost_at(*spans: tuple[int, int]) -> np.ndarray:
    """Which frame is said at each of 120, where a tracker stands still in spans."""
    said = FRAMES.copy()
    for first, end in spans:
        said[first:end] = first - 1
    return said


SAID = {
    "lost": lost_at((50, 53), (80, 94)),
    "stays late": np.maximum(FRAMES - 3, np.minimum(FRAMES, 50)),
    "30 a second": FRAMES // 2 * 2,
    "48 a second": FRAMES - (FRAMES % 5 == 4),
}


@pytest.mark.parametrize("said", SAID.values(), ids=SAID)
def test_of_who_moves_each_repeat_is_found(said):
    """But those before her first step and after her last: who stands there may be standing."""
    moving = np.sin(0.02 * said[:, None] + np.arange(69))
    moving += 1e-14 * np.random.default_rng(0).standard_normal(moving.shape)  # as rounding does
    expected = np.diff(said, prepend=-1) == 0
    expected[[1, -1]] = False
    np.testing.assert_array_equal(repeated_frames(moving, FPS), expected)


def halting(begin: float, end: float) -> np.ndarray:
    """A way of 1 that begins and ends softly."""
    part = np.clip((FRAMES / FPS - begin) / (end - begin), 0, 1)
    return part**2 * (3 - 2 * part)


NO_REPEATS = {
    "halts softly": halting(0.3, 0.8) + halting(0.9, 1.5),
    "stands first and last": np.clip(FRAMES, 30, 90) / 60,
    "turns back between two frames": np.cos(0.1 * (FRAMES - 59.5)),
    "waits half a second": np.clip(FRAMES, 0, 40) + np.clip(FRAMES - 70, 0, None),
    "rounded, nearly still": np.round(1e-3 * FRAMES / FPS, 4),
}


@pytest.mark.parametrize("way", NO_REPEATS.values(), ids=NO_REPEATS)
def test_who_halts_turns_or_stands_repeats_nothing(way):
    assert not repeated_frames(way[:, None] * np.ones(69), FPS).any()


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_few_frames_repeat_nothing(frames):
    assert not repeated_frames(np.ones((frames, 69)), FPS).any()


def sample_as(path: Path, name: str, said: np.ndarray) -> Path:
    """A sample of which other frames are said."""
    with np.load(sample_path(name)) as sample:
        arrays = dict(sample)
    save(path, arrays, **{key: arrays[key][said] for key in ("poses", "trans")})
    return path


@pytest.mark.parametrize("kind", ["lost", "30 a second"])
@pytest.mark.parametrize("name", ["walking", "dancing", "jumping_jacks"])
def test_they_are_drawn_near_to_what_was_there(tmp_path, name, kind):
    true = load_motion(sample_as(tmp_path / "true.npz", name, FRAMES))
    found = load_motion(sample_as(tmp_path / "said.npz", name, SAID[kind]))
    assert true.notes == ()
    repeated = repeated_frames(true.theta[SAID[kind]], FPS)
    (told,) = found.notes
    assert f"repeats {repeated.sum()} of its 120 frames while the body moves" in told
    assert f"first at {repeated.argmax() / FPS:.2f} s" in told
    off, said_off = (np.abs(theta - true.theta) for theta in (found.theta, true.theta[SAID[kind]]))
    assert np.square(off[repeated]).mean() < 0.25 * np.square(said_off[repeated]).mean()
    assert off[SAID[kind] == FRAMES].max() < 1e-12
