"""The captured-like form: sizes, what each part depends on, and what explains it away."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.laws.captured import CapturedForm
from bridge.body import load_body_model
from bridge.body.posing import joint_rotations, pose_features
from bridge.body.surface_operators import vertex_normals
from bridge.motion import unpack_theta

ELBOW = slice(3 * 18, 3 * 19)


@pytest.fixture(scope="module")
def data():
    return load_body_model("embedded:female")


@pytest.fixture(scope="module")
def form(data):
    return CapturedForm(data, seed=3)


def bent(angles, part=ELBOW):
    theta = np.zeros((len(angles), 69))
    theta[:, part] = np.array(angles)[:, None] * np.array([0.0, 0.6, 0.8])
    return theta


def lengths_mm(field):
    return 1000 * np.linalg.norm(field, axis=-1)


def rms_mm(field):
    return float(np.sqrt((lengths_mm(field) ** 2).mean()))


def test_the_misfit_of_pose_is_some_mm_about_the_joints_that_bend(data, form):
    rest, misfit = form.pose_misfit(bent([0.0, np.pi / 2]))
    np.testing.assert_allclose(rest, 0, atol=1e-15)
    size = lengths_mm(misfit)
    assert 1 < size.max() < 8
    elbow = data.joints[18]
    assert np.linalg.norm(data.v_template - elbow, axis=1)[size > 1].max() < 0.25


def test_blend_shapes_cannot_follow_it(form, data):
    """A least-squares fit by all entries of R - I, in 400 poses, leaves a good part in others."""
    draw = np.random.default_rng(0)
    theta = np.zeros((600, 69))
    theta[:, 3:66] = draw.normal(size=(600, 63)) * 0.5
    features = pose_features(joint_rotations(data, unpack_theta(theta)[0]))
    some = slice(None, None, 23)
    misfit = form.pose_misfit(theta)[:, some].reshape(600, -1)
    fit, *_ = np.linalg.lstsq(features[:400], misfit[:400], rcond=None)
    left = misfit[400:] - features[400:] @ fit
    assert (left**2).sum() > 0.2 * (misfit[400:] ** 2).sum()


def test_the_misfit_of_pose_changes_smoothly_with_it(form):
    path = form.pose_misfit(bent(np.linspace(0, 2.5, 251)))
    assert lengths_mm(np.diff(path, axis=0)).max() < 0.1


def test_the_misfit_of_a_person_is_hers_and_no_betas_explain_it(data, form):
    hers, another = form.person_misfit("50004"), form.person_misfit("99001")
    for misfit in (hers, another):
        assert 1 <= rms_mm(misfit) <= 3
    assert rms_mm(hers - another) > 1
    overlap = np.einsum("vxs,vx->s", data.shapedirs, hers)
    np.testing.assert_allclose(overlap / np.abs(data.shapedirs).sum((0, 1)), 0, atol=1e-12)
    np.testing.assert_allclose(hers.mean(0), 0, atol=1e-12)


def test_misfits_are_smooth_over_the_surface(data, form):
    faces = data.faces
    edges = np.linalg.norm(data.v_template[faces[:, 0]] - data.v_template[faces[:, 1]], axis=1)
    for misfit in (form.person_misfit("50004"), form.pose_misfit(bent([2.0]))[0]):
        steps = np.linalg.norm(misfit[faces[:, 0]] - misfit[faces[:, 1]], axis=1)
        assert np.quantile(steps / edges, 0.99) < 0.25


def test_registrations_slide_along_the_skin_slowly_and_have_noise(data, form):
    still = np.broadcast_to(data.v_template, (180, 6890, 3)).astype(np.float32)
    change = form.registered("50004_hips", still, 60.0).astype(np.float64) - still
    normals = vertex_normals(data.v_template, data.faces)
    across = (change * normals).sum(-1)
    # White noise has no direction: across the skin there is a third of its variance, and no more.
    noise_mm = 1000 * np.sqrt(3 * (across**2).mean())
    assert 0.3 < noise_mm < 1.0
    fast_mm = rms_mm(np.diff(change, axis=0)) / np.sqrt(2)
    np.testing.assert_allclose(fast_mm, noise_mm, rtol=0.02)
    slide_mm = np.sqrt(rms_mm(change) ** 2 - noise_mm**2)
    assert 0.5 < slide_mm < 2.5


def test_what_slides_turns_with_the_body(data, form):
    still = np.broadcast_to(data.v_template, (3, 6890, 3)).astype(np.float32)
    turn = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]], np.float32)
    change, turned = (
        form.registered("50004_hips", meshes, 60.0) - meshes for meshes in (still, still @ turn.T)
    )
    noise = np.sqrt(((change - turned) ** 2).sum(-1).mean())
    slid = turned @ turn
    agreement = ((change - slid) ** 2).sum(-1).mean()
    assert agreement < 3 * noise**2
    assert (change.mean(0) * slid.mean(0)).sum() > 0.4 * (change.mean(0) ** 2).sum()


def test_the_same_seed_gives_the_same_and_another_another(data, form):
    again, other = CapturedForm(data, seed=3), CapturedForm(data, seed=4)
    theta, still = bent([0.3, 1.0]), np.zeros((2, 6890, 3), np.float32) + data.v_template
    for method, arguments in (
        ("static", ("50004", theta)),
        ("registered", ("50004_hips", still, 60.0)),
    ):
        one, same, new = (getattr(which, method)(*arguments) for which in (form, again, other))
        np.testing.assert_array_equal(one, same)
        assert np.abs(one - new).max() > 1e-4
    np.testing.assert_array_equal(form.pose_misfit(theta), other.pose_misfit(theta))
