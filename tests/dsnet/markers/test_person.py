"""The shape of a person whose markers were on skin."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bridge.body import load_body_model
from bridge.body.posing import Smpl, shaped_joints
from bridge.body.surface_operators import vertex_normals
from bridge.motion import Motion, load_motion, unpack_theta
from bridge.motion.motion import Y_UP_FROM_Z_UP
from bridge.motion.readers.amass import motion_path
from dsnet.markers.marker_files import Markers, markers_of
from dsnet.markers.person import fit_person
from dsnet.markers.registration import register
from dsnet.prediction.shape_space import with_betas_on
from dsnet.prediction.shapes import MeasuredBody
from tests.forged.amass import load_amass_motion

BODY = load_body_model("embedded:female")
SAMPLE = Path(os.environ.get("DSNET_TEST_DATA", "nowhere")) / "amass" / "dmpl_sample.npz"


def test_markers_tell_a_known_person() -> None:
    """Sixty markers 9.5 mm off her skin: stature and girths come back, betas unseen."""
    motion = load_amass_motion("sample:dancing")
    motion = replace(motion, theta=motion.theta[::8])
    hers = np.array([1.5, -1.0, 1.0, 0, 0, 0, 0, 0, 0, 0])
    own = replace(motion, betas=hers)
    own = own.about_root_joint(shaped_joints(BODY, hers[None])[0, 0])
    rows = np.random.default_rng(0).choice(BODY.vertex_count, 60, replace=False)
    pose, trans = unpack_theta(own.theta)
    skin = np.asarray(Smpl(BODY, dtype=np.float64).person(hers).pose(pose, trans))
    out = np.stack([vertex_normals(frame, BODY.faces)[rows] for frame in skin])
    points_m = skin[:, rows] + 0.0095 * out
    markers = Markers(points_m, tuple(f"M{row}" for row in rows), motion.fps)
    found = fit_person(BODY, motion, markers)
    assert found.fitted_mm < 20 < found.mean_shape_mm
    real, fitted, mean = (MeasuredBody(BODY)(b) for b in (hers, found.betas, np.zeros(10)))
    assert abs(mean["weight"] - real["weight"]) > 8
    assert abs(fitted["height"] - real["height"]) < 2
    assert abs(fitted["weight"] - real["weight"]) < 3


@pytest.mark.parametrize(
    ("frames", "times_the_rate"), [(1, 1), (3, 1), (1, 2), (2, 2), (3, 2), (4, 2), (15, 2), (16, 2)]
)
def test_a_take_shorter_than_its_filter_tells_a_shape_too(frames: int, times_the_rate: int) -> None:
    """With gaps from three frames on; at twice the motion's rate markers are low-passed."""
    motion = load_amass_motion("sample:dancing")
    motion = replace(motion, theta=motion.theta[: -(-frames // times_the_rate)])
    rows = np.random.default_rng(0).choice(BODY.vertex_count, 40, replace=False)
    person = Smpl(BODY, rows, np.float64).person(np.zeros(10))
    pelvis_m = shaped_joints(BODY, np.zeros((1, 10)))[0, 0]
    posed = person.pose(*unpack_theta(motion.about_root_joint(pelvis_m).theta))
    skin = np.asarray(posed, np.float64)
    points_m = skin.repeat(times_the_rate, axis=0)[:frames]
    points_m[1:2, : 10 if frames > 2 else 0] = np.nan
    markers = Markers(points_m, tuple(f"M{row}" for row in rows), times_the_rate * motion.fps)
    assert fit_person(BODY, motion, markers).fitted_mm < 10


def test_zero_betas_beside_markers_give_way_to_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hers = np.array([2.0, -1.5, 1.5, 0, 1, 0, 0, 0, 0, 0])
    motion = load_amass_motion("sample:dancing")
    own = replace(motion, betas=hers)
    own = own.about_root_joint(shaped_joints(BODY, hers[None])[0, 0])
    rows = np.random.default_rng(0).choice(BODY.vertex_count, 60, replace=False)
    skin = np.asarray(Smpl(BODY, rows, np.float64).person(hers).pose(*unpack_theta(own.theta)))
    z_up = Y_UP_FROM_Z_UP.inv().apply(skin.reshape(-1, 3)).reshape(skin.shape)
    with np.load(motion_path("sample:dancing")) as stored:
        arrays = {key: stored[key] for key in stored if key != "source"}
    arrays["betas"] = np.zeros(16)
    np.savez(tmp_path / "bare.npz", **arrays)
    labels = np.array([f"M{row}X" for row in rows])
    np.savez(tmp_path / "a.npz", **arrays, marker_data=z_up, marker_labels=labels)
    fitted = with_betas_on(load_motion(tmp_path / "a.npz"), BODY).betas
    assert "are all zero: the shape is fitted to its markers" in capsys.readouterr().err
    assert np.abs(fitted - hers)[:2].max() < 1
    assert not with_betas_on(load_motion(tmp_path / "bare.npz"), BODY).betas.any()
    assert not capsys.readouterr().err


def off_mm(motion: Motion, markers: Markers, betas: np.ndarray) -> float:
    own = replace(motion, betas=betas).about_root_joint(shaped_joints(BODY, betas[None])[0, 0])
    return float(np.median([*register(BODY, own, markers).distance_mm.values()]))


@pytest.mark.skipif(not SAMPLE.exists(), reason="no $DSNET_TEST_DATA/amass/dmpl_sample.npz")
def test_real_markers_lie_nearer_to_the_fitted_skin(capsys: pytest.CaptureFixture[str]) -> None:
    """Medians: 31 mm with the file's betas, 36 with the mean shape, 27."""
    motion = load_motion(SAMPLE, 60.0)
    markers = markers_of(motion)
    fitted = with_betas_on(motion, BODY)
    assert "the shape is fitted to its markers" in capsys.readouterr().err
    by_file, mean, now = (
        off_mm(motion, markers, betas) for betas in (motion.betas, np.zeros(10), fitted.betas)
    )
    assert [round(mm) for mm in (by_file, mean, now)] == [31, 36, 27]
