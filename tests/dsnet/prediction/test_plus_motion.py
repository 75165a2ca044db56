"""`dsnet_plus` on a whole motion: as the model says, piece by piece, anew after a cut."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from bridge.body import load_body_model
from bridge.motion import load_motion
from bridge.motion.smoothing import SmoothHz
from dsnet.prediction.controls import Controls
from dsnet.prediction.models import FRAMES_AT_ONCE, PlusModel, predict_whole
from dsnet.prediction.moving_body import place_motion
from dsnet.prediction.prediction_files import predict_motion
from dsnet.verify.reference.oscillators import node_offsets
from tests.forged.amass import save, smplh

BODY = load_body_model("embedded:female")


def hopping(path: Path, frames: int = 151) -> Path:
    """At 60 fps, z up: hops of 10 cm and a swinging arm."""
    times_s = np.arange(frames) / 60
    poses, trans = np.zeros((frames, 156)), np.zeros((frames, 3))
    poses[:, 0] = np.pi / 2
    poses[:, 16 * 3 + 2] = -1.0 + 0.3 * np.sin(9 * times_s)
    trans[:, 2] = 0.9 + 0.1 * np.abs(np.sin(7 * times_s))
    return save(path, smplh(frames, 60.0), poses=poses, trans=trans, source="synthetic")


def theta_of(path: Path) -> tuple[np.ndarray, np.ndarray]:
    motion = place_motion(load_motion(path), BODY)
    return motion.theta, motion.betas


def whole(found) -> np.ndarray:
    return np.concatenate(list(found.offsets_m))


@pytest.mark.parametrize("look_ahead", [0, 1])
@pytest.mark.parametrize("frames", [1, 2, FRAMES_AT_ONCE + 1, 151])
def test_pieces_are_the_whole_motion(flesh, tmp_path, look_ahead, frames):
    theta, betas = theta_of(hopping(tmp_path / "hop.npz", frames))
    model = replace(flesh, look_ahead=look_ahead)
    found = predict_whole(PlusModel(model, BODY), theta, betas)
    assert found.latents is None
    expected = model.nodes.spread(node_offsets(model, BODY, theta, betas))
    np.testing.assert_allclose(whole(found), expected, atol=1e-6)


def test_what_is_static_is_added(flesh, tmp_path):
    theta, betas = theta_of(hopping(tmp_path / "hop.npz", 70))
    by_pose = np.random.default_rng(2).normal(0, 1e-3, flesh.static.by_pose_m.shape)
    static = replace(flesh.static, by_pose_m=by_pose.astype(np.float32))
    model = replace(flesh, static=static)
    added = whole(predict_whole(PlusModel(model, BODY), theta, betas))
    added -= whole(predict_whole(PlusModel(flesh, BODY), theta, betas))
    assert np.abs(added).max() > 1e-4
    np.testing.assert_allclose(added, model.static_m(BODY, betas, theta), atol=1e-6)


def test_a_motion_begins_at_rest_in_its_first_pose(flesh, tmp_path):
    """Also one that is cut out of a jump: its first load has no acceleration."""
    theta, betas = theta_of(hopping(tmp_path / "hop.npz", 60))
    predict = partial(predict_whole, PlusModel(flesh, BODY))
    standing = whole(predict(theta[30:31].repeat(3, axis=0), betas))
    np.testing.assert_allclose(whole(predict(theta[30:], betas))[0], standing[0], atol=1e-7)


def test_who_stands_as_she_was_scanned_is_not_moved(flesh):
    found = whole(predict_whole(PlusModel(flesh, BODY), np.zeros((90, 69)), np.zeros(10)))
    np.testing.assert_allclose(found, 0.0, atol=1e-9)


@pytest.mark.usefixtures("blank_strip", "plus_run")
def test_after_a_cut_a_motion_is_predicted_as_by_itself(cut_motion, plus_run, tmp_path, capsys):
    whole, parts = cut_motion
    said, made = predict(plus_run, whole, tmp_path / "whole", capsys)
    assert "cut.npz jumps at frame 40 (0.67 s) of its 60 frames a second" in said
    assert said.count("\n") == 3
    assert made.manifest["starts_anew_at"] == [40]
    alone = [predict(plus_run, part, tmp_path / part.stem, capsys)[1] for part in parts]
    for name in ("offsets", "vertices"):
        joined = np.concatenate([part.array(name) for part in alone])
        np.testing.assert_allclose(made.array(name), joined, atol=1e-6)
    assert np.abs(made.array("offsets")).max() < 0.05


@pytest.mark.usefixtures("blank_strip")
def test_a_rate_that_cannot_be_right_is_told_and_corrected(plus_run, tmp_path, capsys):
    """Hops of 10 cm, written at three times their rate."""
    with np.load(hopping(tmp_path / "hop.npz", 121)) as stored:
        fast = save(tmp_path / "fast.npz", {**stored, "mocap_framerate": 180.0})
    said, made = predict(plus_run, fast, tmp_path / "fast", capsys)
    assert said.count("\n") == 4
    assert "fast.npz falls with" in said
    assert "fast.npz moves faster than anybody can: root at" in said
    assert "at its 180 frames a second" in said
    assert len(made.array("vertices")) == 41
    mended = Controls(motion_fps=60.0)
    said, made = predict(plus_run, fast, tmp_path / "mended", capsys, mended)
    assert "falls" not in said
    own = predict(plus_run, tmp_path / "hop.npz", tmp_path / "own", capsys)[1]
    np.testing.assert_array_equal(made.array("vertices"), own.array("vertices"))
    assert (made.manifest["source_fps"], made.manifest["controls"]) == (60.0, {"motion_fps": 60.0})


@pytest.mark.usefixtures("blank_strip")
def test_a_noisy_recording_is_told_and_smoothed(plus_run, tmp_path, capsys):
    """A hop recorded with an error of a millimetre shakes the skin; smoothed it hardly does."""
    with np.load(hopping(tmp_path / "hop.npz", 121)) as stored:
        noise = 0.001 * np.random.default_rng(0).standard_normal(stored["trans"].shape)
        noisy = save(tmp_path / "noisy.npz", {**stored, "trans": stored["trans"] + noise})
    made, said = {}, {}
    asked: dict[str, SmoothHz | None]
    asked = {"clean": 8.0, "raw": None, "smoothed": 8.0, "as it moves": "auto"}
    for name, smooth_hz in asked.items():
        source = tmp_path / "hop.npz" if name == "clean" else noisy
        controls = Controls(smooth_hz=smooth_hz)
        said[name], made[name] = predict(plus_run, source, tmp_path / name, capsys, controls)
    assert "noisy.npz trembles by" in said["raw"]
    for name in ("smoothed", "as it moves"):
        assert "trembles" not in said[name]
        assert made[name].manifest["controls"] == {"smooth_hz": asked[name]}
    clean = made["clean"].array("offsets")
    raw, smooth = (np.abs(made[n].array("offsets") - clean).mean() for n in ("raw", "smoothed"))
    assert smooth < 0.5 * raw


@pytest.mark.usefixtures("blank_strip")
def test_the_networks_start_anew_too(cut_motion, trained_run, tmp_path, capsys):
    whole, parts = cut_motion
    said, made = predict(trained_run, whole, tmp_path / "whole", capsys)
    assert "jumps at frame 40" in said
    alone = [predict(trained_run, part, tmp_path / part.stem, capsys)[1] for part in parts]
    joined = np.concatenate([part.array("latents") for part in alone])
    np.testing.assert_allclose(made.array("latents"), joined, atol=1e-5)
    assert len(made.array("offsets")) == 90


def predict(run, path, out, capsys, controls=None):
    capsys.readouterr()
    made = predict_motion(run, path, out, controls=controls)
    return capsys.readouterr().err, made


@pytest.fixture
def cut_motion(tmp_path) -> tuple[Path, list[Path]]:
    """Ninety frames, of which those from the fortieth on are 1 m off; and both parts alone."""
    with np.load(hopping(tmp_path / "hop.npz", 90)) as stored:
        arrays = dict(stored)
    arrays["trans"][40:, 0] += 1.0

    def part(name: str, rows: slice) -> Path:
        moving = {key: arrays[key][rows] for key in ("poses", "trans")}
        given = smplh(len(moving["poses"]), 60.0)
        return save(tmp_path / f"{name}.npz", given, source="synthetic", **moving)

    parts = [part("before", slice(40)), part("after", slice(40, None))]
    return part("cut", slice(None)), parts
