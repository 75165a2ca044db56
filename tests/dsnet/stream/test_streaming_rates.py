"""At any frame rate: what a file of that rate is predicted, and nearly what 60 a second give."""

from __future__ import annotations

from fractions import Fraction
from functools import partial

import numpy as np
import pytest

from bridge.body import load_body_model
from bridge.motion import pack_theta
from bridge.motion.cuts import pieces_between_cuts
from dsnet.prediction.models import PlusModel, predict_whole
from dsnet.stream.streams import Stream
from tests.forged.amass import load_as_it_lies, save, smplh
from tests.forged.swaying import swaying

BODY = load_body_model("embedded:female")
BETAS = np.linspace(-1, 1, 10)


def streamed(model, theta: np.ndarray, fps: float) -> np.ndarray:
    """Offsets of all frames."""
    bodies = Stream(model, body=BODY, fps=fps)
    who = bodies.join(BETAS)
    answers = [bodies.step({who: pose})[who] for pose in theta]
    late = [*answers[bodies.latency_frames :], *bodies.leave(who)]
    return np.stack([body.offsets_m for body in late])


def whole(model, theta: np.ndarray) -> np.ndarray:
    predict = partial(predict_whole, PlusModel(model, BODY))
    pieces = [predict(theta[piece], BETAS).offsets_m for piece in pieces_between_cuts(theta)]
    return np.concatenate([offsets for piece in pieces for offsets in piece])


def common(fps: int, offsets: np.ndarray, ticks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of offsets at a rate and at 60 frames a second, those at the same instants."""
    ratio = Fraction(60, fps)
    offsets, ticks = offsets[:: ratio.denominator], ticks[:: ratio.numerator]
    count = min(len(offsets), len(ticks))
    assert count > 5
    return offsets[:count], ticks[:count]


@pytest.mark.parametrize("fps", [24, 30, 60, 90, 100, 120])
@pytest.mark.parametrize("cut", [None, 21])
def test_a_stream_is_its_file_resampled_and_predicted(flesh, tmp_path, fps, cut, monkeypatch):
    """`load_motion` resamples the file, across no cut either; then 1e-5 m.

    Without the splines through slow files, which look ahead.
    """
    monkeypatch.setattr("bridge.motion.resampling._FEWEST_OF_SPLINE", np.inf)
    frames = int(0.8 * fps) if cut is None else 2 * cut
    theta = swaying(np.arange(frames) / fps)
    if cut is not None:
        theta[cut:, 66] += 0.9
    poses = np.zeros((frames, 156))
    poses[:, :66] = theta[:, :66]
    path = save(tmp_path / "m.npz", smplh(frames, float(fps)), poses=poses, trans=theta[:, 66:])
    resampled = load_as_it_lies(path).theta
    assert len(pieces_between_cuts(resampled)) == (1 if cut is None else 2)
    stored = pack_theta(poses[:, :66].reshape(-1, 22, 3), theta[:, 66:])
    found, expected = common(fps, streamed(flesh, stored, fps), whole(flesh, resampled))
    np.testing.assert_allclose(found, expected, atol=1e-5)
    assert np.abs(expected).max() > 3e-3


@pytest.mark.parametrize(
    ("fps", "missed"), [(30, 5e-3), (90, 1e-4), (120, 1e-9)], ids=["30", "90", "120"]
)
def test_a_smooth_motion_is_nearly_the_same_at_any_rate(flesh, fps, missed):
    """Between frames a pose is a guess: at 30 fps every other tick's, at 90 fps half of a third's.

    `missed` is the share of the offsets' energy.
    """
    found = streamed(flesh, swaying(np.arange(fps + 1) / fps), fps)
    expected = whole(flesh, swaying(np.arange(61) / 60))
    found, expected = common(fps, found, expected)
    assert np.square(found - expected).sum() < missed * np.square(expected).sum()


@pytest.mark.parametrize("fps", [90, 120])
def test_frames_between_ticks_are_between_their_offsets(flesh, fps):
    found = streamed(flesh, swaying(np.arange(fps // 2) / fps), fps)
    jerks = np.abs(np.diff(found, n=3, axis=0)).max()
    # A frame that repeated its tick's offsets would jump by a frame's change.
    assert jerks < 0.8 * np.abs(np.diff(found, axis=0)).max()


@pytest.mark.parametrize("fps", [90, 240])
@pytest.mark.parametrize("cut", [17, 18, 19, 20])
def test_no_frame_mixes_both_sides_of_a_cut(flesh, fps, cut):
    """She hangs askew, then stands as she was scanned, elsewhere: without any offset."""
    theta = np.tile(swaying(np.zeros(1)), (40, 1))
    theta[cut:] = 0
    theta[cut:, 66] = 3.0
    sizes_m = np.abs(streamed(flesh, theta, fps)).max(axis=(1, 2))
    np.testing.assert_allclose(sizes_m[:cut], sizes_m[0], rtol=0.02)
    np.testing.assert_allclose(sizes_m[cut:], 0.0, atol=1e-7)
    assert sizes_m[0] > 1e-3
