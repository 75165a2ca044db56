"""Noise of a recording: named where it is, left out on demand, while the motion stays in time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bridge.errors import DsnetError
from bridge.motion import load_motion
from bridge.motion.motion import RATES_HZ, Motion
from bridge.motion.motion_checks import motion_warnings, tremor_mm
from bridge.motion.readers.amass import SAMPLES, sample_path
from bridge.motion.smoothing import SmoothHz, StreamSmoother, no_noise_hz, noise_cutoff_hz, smoothed
from bridge.motion.theta import pack_theta
from tests.forged.amass import save, smplh

FPS = 120.0


def of(pose: np.ndarray, trans_m: np.ndarray, fps: float = FPS) -> Motion:
    theta = pack_theta(pose, trans_m)
    return Motion(theta, np.zeros(10), "unknown", fps, fps, Path("walk.npz"), up="z")


def slow(frames: int = 480) -> Motion:
    """Turns of 1 Hz, in which the root goes round the whole way, and a sway of 10 cm."""
    time_s = np.arange(frames) / FPS
    pose, trans_m = np.zeros((frames, 22, 3)), np.zeros((frames, 3))
    pose[:, 0] = Rotation.from_rotvec(np.outer(2 * np.pi * time_s, [0, 0, 1])).as_rotvec()
    pose[:, 3, 0] = 0.4 * np.sin(2 * np.pi * time_s)
    trans_m[:, 1] = 0.1 * np.sin(2 * np.pi * time_s)
    return of(pose, trans_m)


def trembling(motion: Motion, size: float = 0.002) -> Motion:
    """With white noise of so many metres, and twice as many radians."""
    rng = np.random.default_rng(0)
    noise = 2 * size * rng.standard_normal(motion.pose.shape)
    pose = Rotation.from_rotvec(motion.pose.reshape(-1, 3)) * Rotation.from_rotvec(
        noise.reshape(-1, 3)
    )
    trans_m = motion.trans_m + size * rng.standard_normal(motion.trans_m.shape)
    return of(pose.as_rotvec().reshape(motion.pose.shape), trans_m, motion.fps)


def apart_rad(one: Motion, other: Motion) -> np.ndarray:
    turns = (Rotation.from_rotvec(m.pose.reshape(-1, 3)) for m in (one, other))
    first, second = turns
    return (first.inv() * second).magnitude().reshape(len(one.pose), -1)


def test_what_people_do_stays_where_and_when_it_was() -> None:
    """But for the ends, where a filter knows one side only; a root that turns round stays whole."""
    found, inside = smoothed(slow(), 8.0), slice(30, -30)
    assert apart_rad(found, slow())[inside].max() < 1e-3
    assert np.abs(found.trans_m - slow().trans_m)[inside].max() < 1e-4


def test_noise_is_left_out() -> None:
    noisy = trembling(slow())
    found = smoothed(noisy, 8.0)
    for measure in (
        lambda m: apart_rad(m, slow())[30:-30].std(),
        lambda m: (m.trans_m - slow().trans_m)[30:-30].std(),
        lambda m: 10 * np.diff(m.trans_m, 2, axis=0)[30:-30].std(),
    ):
        assert measure(found) < 0.5 * measure(noisy)
    assert tremor_mm(noisy.trans_m[::2], FPS / 2) > 1
    assert tremor_mm(found.trans_m[::2], FPS / 2) < 0.45


@pytest.mark.parametrize("smooth_hz", [8.0, "auto"])
def test_a_cut_stays_one(smooth_hz: SmoothHz) -> None:
    whole = slow(240)
    trans_m = whole.trans_m + np.where(np.arange(240) < 120, 0.0, 3.0)[:, None]
    found = smoothed(of(whole.pose, trans_m), smooth_hz)
    np.testing.assert_allclose(found.trans_m[118:122, 0], [0, 0, 3, 3], atol=1e-9)
    one = of(whole.pose[:1], whole.trans_m[:1])
    np.testing.assert_allclose(smoothed(one, smooth_hz).trans_m, one.trans_m)


def landing(fps: float = FPS) -> Motion:
    """Two seconds of slow sway, two in which somebody lands every half second, two of sway."""
    time_s = np.arange(int(6 * fps)) / fps
    whole = slow(len(time_s))
    jumps = np.where((time_s > 2) & (time_s < 4), np.abs(np.sin(2 * np.pi * time_s)), 0.0)
    trans_m = np.zeros((len(time_s), 3))
    trans_m[:, 2] = 0.3 * jumps
    return of(np.zeros_like(whole.pose), trans_m, fps)


@pytest.mark.parametrize("fps", [30.0, 60.0, 120.0])
def test_the_cutoff_follows_the_motion(fps: float) -> None:
    """High where somebody lands, low where nothing but noise is fast, and highest without noise."""
    clean = landing(fps)
    noisy = trembling(clean, 0.0005)
    calm, landings = (
        np.r_[0 : int(fps), int(5 * fps) : int(6 * fps)],
        slice(int(2.5 * fps), int(3.5 * fps)),
    )
    found = noise_cutoff_hz(noisy.pose, noisy.trans_m, fps)
    assert np.median(found[landings]) > 1.5 * np.median(found[calm])
    without = noise_cutoff_hz(clean.pose, clean.trans_m, fps)
    assert np.median(without[landings]) > np.median(found[landings])
    assert without.max() < no_noise_hz(fps) + 1e-9 < fps / 2


def test_auto_keeps_landings_and_leaves_noise_out() -> None:
    clean = landing()
    noisy = trembling(clean, 0.0005)
    away = {hz: np.abs(smoothed(noisy, hz).trans_m - clean.trans_m) for hz in (8.0, "auto")}
    calm, landings = slice(30, 180), slice(240, 480)
    assert away["auto"][calm].mean() < 0.9 * away[8.0][calm].mean()
    assert away["auto"][landings].max() < 0.7 * away[8.0][landings].max()


@pytest.mark.parametrize("frames", [1, 2, 3, 15, 16, 17, 40])
def test_auto_takes_the_shortest(frames: int) -> None:
    whole = slow(frames)
    found = smoothed(whole, "auto")
    assert apart_rad(found, whole).max() < 1e-3
    np.testing.assert_allclose(found.trans_m, whole.trans_m, atol=1e-3)


@pytest.mark.parametrize("fps", [*RATES_HZ, 10.0, 17.9, 18.1, 24.0])
def test_auto_takes_the_slowest_and_the_fastest(fps: float) -> None:
    """Where frames are too few to tell noise from motion, nothing is left out."""
    whole = replace(slow(200), fps=fps)
    found = smoothed(whole, "auto")
    assert np.isfinite(found.pose).all()
    if fps < 18:
        np.testing.assert_allclose(found.trans_m, whole.trans_m, atol=1e-12)


@pytest.mark.parametrize("cutoff_hz", [0.0, 1e-320, 60.0, np.nan])
def test_a_rate_that_the_motion_lacks_is_refused(cutoff_hz: float) -> None:
    with pytest.raises(DsnetError, match="120 frames a second, smoothed at"):
        smoothed(slow(), cutoff_hz)


def said_of(motion: Motion) -> list[str]:
    """Of how it moves; that its root turns right round is told too."""
    said = motion_warnings(motion)
    return [line for line in said if "--up" not in line]


def test_a_file_that_trembles_is_named_and_then_smoothed(tmp_path: Path) -> None:
    noisy = trembling(slow())
    path = tmp_path / "walk.npz"
    poses = np.zeros((480, 156))
    poses[:, :66] = noisy.pose.reshape(480, 66)
    save(path, smplh(480, FPS), poses=poses, trans=noisy.trans_m)
    raw, still = load_motion(path), load_motion(path, smooth_hz=8.0)
    (line,) = said_of(raw)
    assert "walk.npz trembles by" in line
    assert "--smooth-hz auto leaves that out" in line
    found = load_motion(path, smooth_hz="auto")
    assert said_of(found) == []
    assert found.smooth_hz == "auto"
    assert said_of(still) == []
    assert (raw.smooth_hz, still.smooth_hz) == (None, 8.0)
    assert len(raw.theta) == len(still.theta)


@pytest.mark.parametrize("name", SAMPLES)
def test_a_motion_without_noise_is_left_as_it_is(name: str) -> None:
    motion = load_motion(sample_path(name))
    calmed = load_motion(sample_path(name), smooth_hz="auto")
    assert np.abs(calmed.theta - motion.theta)[:, 66:].max() < 5e-4
    turns = [Rotation.from_rotvec(m.theta[:, :66].reshape(-1, 3)) for m in (motion, calmed)]
    assert np.degrees((turns[0].inv() * turns[1]).magnitude()).max() < 5


def streamed(motion: Motion) -> Motion:
    """Frame by frame."""
    smoother = StreamSmoother(motion.fps)
    given = [smoother.push(theta) for theta in motion.theta]
    assert [theta is None for theta in given] == [0 < n <= 3 for n in range(len(given))]
    known = [theta for theta in given if theta is not None]
    return replace(motion, theta=np.stack([*known, *smoother.finish()]))


@pytest.mark.parametrize("fps", [10.0, 30.0, 60.0, 120.0, 1000.0])
def test_a_stream_that_is_smooth_already_stays(fps):
    """A path of even acceleration, and an arm that goes round once a second."""
    time_s = np.arange(90) / fps
    pose, trans_m = np.zeros((90, 22, 3)), np.zeros((90, 3))
    pose[:, 16] = np.outer(2 * np.pi * time_s, [0, 0.6, 0.8])
    trans_m[:, 1] = 1.0 - 4.9 * time_s**2 / fps
    calm = streamed(of(pose, trans_m, fps))
    np.testing.assert_allclose(calm.trans_m, trans_m, atol=1e-8)
    np.testing.assert_allclose(calm.pose[:, 16], pose[:, 16], atol=1e-2)


def test_a_stream_loses_its_noise_and_is_not_late():
    motion = of(slow().pose[::2], slow().trans_m[::2], 60.0)
    noisy = trembling(motion, 0.0007)
    calm = streamed(noisy)

    def felt(one: Motion) -> float:
        return float(np.diff(one.trans_m - motion.trans_m, 2, axis=0).std())

    assert felt(calm) < 0.1 * felt(noisy)
    late = [
        np.abs(calm.trans_m[9:-9, 1] - motion.trans_m[9 - n : -9 - n, 1]).mean() for n in range(3)
    ]
    assert np.argmin(late) == 0


def test_a_stream_goes_on_over_no_cut():
    motion = trembling(of(slow(60).pose, slow(60).trans_m, 60.0), 0.0007)
    theta = motion.theta.copy()
    theta[30:, 66] += 3.0
    both = streamed(replace(motion, theta=theta)).theta
    first = streamed(replace(motion, theta=theta[:30])).theta
    np.testing.assert_allclose(both[:30], first, atol=1e-12)
    assert np.abs(both[30:] - theta[30:]).max() < 0.01
