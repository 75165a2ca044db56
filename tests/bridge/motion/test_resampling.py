"""Motions resampled and turned upright; and the real sample where it is at hand."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bridge import DsnetError
from bridge.body import load_body_model, pose_vertices
from bridge.motion.interpolation import between, going_on
from bridge.motion.theta import unpack_theta
from tests.forged.amass import load_amass_motion, load_as_it_lies, save, smplh
from tests.forged.swaying import swaying

REAL_SAMPLE = Path(os.environ.get("DSNET_TEST_DATA", "nowhere")) / "amass" / "dmpl_sample.npz"
R_YUP_ZUP = Rotation.from_euler("x", -90, degrees=True)


def forge(path: Path, frames: int = 5, fps: float = 120.0, **changes: Any) -> Path:
    return save(path, smplh(frames, fps), **({"dmpls": None} | changes))


@pytest.fixture
def target(tmp_path: Path) -> Path:
    return tmp_path / "motion_poses.npz"


def random_poses(seed: int, frames: int, width: int = 156) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (frames, width))


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6), fps=st.sampled_from([50.0, 100.0, 120.0, 119.88, 250.0]))
def test_constant_motion_stays_constant(
    tmp_path_factory: pytest.TempPathFactory, seed: int, fps: float
) -> None:
    poses = np.repeat(random_poses(seed, 1), 9, axis=0)
    trans = np.tile([0.3, -1.0, 0.9], (9, 1))
    path = forge(tmp_path_factory.getbasetemp() / "c.npz", fps=fps, poses=poses, trans=trans)
    theta = load_amass_motion(path).theta
    np.testing.assert_allclose(theta, np.repeat(theta[:1], len(theta), axis=0), atol=1e-12)


def test_60_to_60_is_the_identity(target: Path) -> None:
    rng = np.random.default_rng(1)
    poses = np.cumsum(rng.uniform(-0.1, 0.1, (40, 156)), axis=0)
    trans = rng.normal(size=(40, 3))
    dmpls = rng.normal(size=(40, 8))
    forge(target, fps=60.0, poses=poses, trans=trans, dmpls=dmpls)
    motion = load_as_it_lies(target)
    np.testing.assert_allclose(motion.theta[:, :66], poses[:, :66], atol=1e-9)
    np.testing.assert_allclose(motion.theta[:, 66:], trans, atol=1e-12)
    assert motion.dmpls is not None
    np.testing.assert_allclose(motion.dmpls, dmpls, atol=1e-12)


@pytest.mark.parametrize("source_fps", [100.0, 120.00004577636719, 30.0])
def test_constant_angular_velocity_is_kept(target: Path, source_fps: float) -> None:
    axis = np.array([1.0, 2.0, -2.0]) / 3
    rate_rad_s, speed_m_s = 3.0, np.array([1.0, 0.0, -0.5])
    source_s = np.arange(101) / source_fps
    poses = np.zeros((101, 156))
    poses[:, 9:12] = rate_rad_s * source_s[:, None] * axis
    motion = load_as_it_lies(
        forge(target, fps=source_fps, poses=poses, trans=source_s[:, None] * speed_m_s)
    )
    pose, trans = unpack_theta(motion.theta)
    times_s = np.minimum(np.arange(len(pose)) / 60.0, source_s[-1])
    assert abs(motion.duration_s - source_s[-1]) < 1 / 60
    np.testing.assert_allclose(pose[:, 3], rate_rad_s * times_s[:, None] * axis, atol=1e-8)
    np.testing.assert_allclose(trans, times_s[:, None] * speed_m_s, atol=1e-9)


def test_rotation_takes_the_short_way_over_pi(target: Path) -> None:
    poses = np.zeros((2, 156))
    poses[:, 7] = np.pi - 0.1, -(np.pi - 0.1)
    pose, _ = unpack_theta(load_as_it_lies(forge(target, 2, 10.0, poses=poses)).theta)
    expected = np.linspace(np.pi - 0.1, np.pi + 0.1, 7)
    np.testing.assert_allclose(pose[:, 2, 1], expected, atol=1e-9)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_axis_angles_are_continuous_through_full_turns(
    tmp_path_factory: pytest.TempPathFactory, seed: int
) -> None:
    axis = np.random.default_rng(seed).normal(size=3)
    turning = np.linspace(0, 5 * np.pi, 60)[:, None] * axis / np.linalg.norm(axis)
    poses = np.zeros((60, 156))
    poses[:, 3:6] = Rotation.from_rotvec(turning).as_rotvec()
    path = forge(tmp_path_factory.getbasetemp() / "t.npz", 60, 60.0, poses=poses)
    pose, _ = unpack_theta(load_amass_motion(path).theta)
    np.testing.assert_allclose(pose[:, 1], turning, atol=1e-6)


def test_last_frame_is_not_extrapolated(target: Path) -> None:
    trans = np.zeros((8, 3))
    trans[:, 0] = 0.1 * np.arange(8)
    motion = load_amass_motion(forge(target, 8, 100.0, trans=trans))
    assert len(motion.theta) == 5
    assert motion.theta[-1, 66] <= 0.7
    np.testing.assert_allclose(motion.theta[:, 66], np.arange(5) * 10 / 60, atol=1e-12)


def test_one_frame(target: Path) -> None:
    motion = load_amass_motion(forge(target, 1, dmpls=np.ones((1, 8))))
    assert motion.theta.shape == (1, 69)
    np.testing.assert_array_equal(motion.dmpls, np.ones((1, 8)))


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_y_up_body_is_the_z_up_body_turned(
    tmp_path_factory: pytest.TempPathFactory, seed: int
) -> None:
    body = load_body_model("embedded:female")
    rng = np.random.default_rng(seed)
    betas = rng.normal(size=(1, 10))
    path = forge(
        tmp_path_factory.getbasetemp() / "y.npz",
        poses=random_poses(seed, 2),
        trans=rng.normal(size=(2, 3)),
    )
    # Far from the origin, so that a root joint that was left out would show.
    moved = body.v_template + np.array([0.1, -0.3, 0.2])
    body = type(body)(**{**vars(body), "v_template": moved})
    root_m = (body.J_regressor @ (body.v_template + body.shapedirs @ betas[0]))[0]
    lying = load_as_it_lies(path)
    standing = load_amass_motion(path, root_joint_m=root_m)
    z_up = pose_vertices(body, betas, *unpack_theta(lying.theta[:1]))
    y_up = pose_vertices(body, betas, *unpack_theta(standing.theta[:1]))
    np.testing.assert_allclose(y_up[0], R_YUP_ZUP.apply(z_up[0]), atol=1e-9)


def test_nonsensical_rate_is_refused(target: Path) -> None:
    with pytest.raises(DsnetError, match="fps=0"):
        load_amass_motion(forge(target), fps=0)


@pytest.mark.skipif(not REAL_SAMPLE.is_file(), reason="no $DSNET_TEST_DATA/amass/dmpl_sample.npz")
def test_real_sample_stands_on_its_floor() -> None:
    body = load_body_model("embedded:female")
    motion = load_amass_motion(REAL_SAMPLE, root_joint_m=body.joints[0])
    assert (motion.gender, len(motion.theta)) == ("female", 118)
    assert motion.dmpls is not None
    assert motion.dmpls.shape == (118, 8)
    pose, trans = unpack_theta(motion.theta[::13])
    vertices = pose_vertices(body, np.zeros((len(pose), 10)), pose, trans)
    lowest_m = vertices[..., 1].min(axis=1)
    assert -0.05 < lowest_m.min() < 0.05
    assert vertices[..., 1].max() > 1.4


def test_between_ends_where_it_should_and_goes_the_short_way():
    before, after = swaying(np.array([0.0, 0.1, 0.2])), swaying(np.array([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(between(before, after, np.zeros(3)), before, atol=1e-12)
    np.testing.assert_array_equal(between(before, after, np.ones(3)), after)
    mixed = between(before, after, np.array([0.0, 0.5, 1.0]))
    np.testing.assert_array_equal(mixed[2], after[2])
    np.testing.assert_allclose(mixed[1], (before[1] + after[1]) / 2, atol=2e-3)
    np.testing.assert_allclose(mixed[1, 66:], (before[1] + after[1])[66:] / 2, atol=1e-12)


def test_between_keeps_the_turns_of_a_spin():
    before = np.zeros((1, 69))
    before[0, 1] = 3 * 2 * np.pi + 0.2
    after = before + 0.1 * np.eye(69)[1]
    np.testing.assert_allclose(
        between(before, after, np.array([0.5])), before + (after - before) / 2
    )


def test_going_on_repeats_the_last_change():
    before, last = swaying(np.array([0.0, 1 / 60]))
    following = going_on(before, last)
    np.testing.assert_allclose(between(before[None], following[None], np.array([0.5]))[0], last)
    np.testing.assert_allclose(going_on(last, last), last, atol=1e-12)
