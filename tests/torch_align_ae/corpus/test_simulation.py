from __future__ import annotations

import numpy as np
import pytest

from bridge.body import load_body_model
from torch_align_ae.corpus.motions import Skeleton, perform
from torch_align_ae.corpus.simulation import TissueSimulator, body_in_double, rest_frame_drive
from torch_align_ae.corpus.subjects import SUBJECTS
from torch_align_ae.corpus.tissue_parameters import tissue_looseness

FRAMES = 70


@pytest.fixture(scope="module")
def smpl():
    return body_in_double(load_body_model("embedded:female"))


@pytest.fixture(scope="module")
def offsets(smpl):
    """Of the heaviest and of the leanest subject, one_leg_jump, by the same pose sequence."""
    heavy, lean = SUBJECTS["female"][0], SUBJECTS["female"][4]
    skeleton = Skeleton.of(smpl.data, heavy.betas)
    theta = perform("one_leg_jump", "50004", skeleton, frame_count=FRAMES, fps=60.0)
    return [TissueSimulator(smpl, who.betas).offsets(theta, 60.0) for who in (heavy, lean)]


def test_a_still_body_has_exactly_no_offsets_without_gravity(smpl):
    betas = SUBJECTS["female"][0].betas
    theta = np.tile(np.linspace(0, 0.3, 69), (10, 1))
    simulator = TissueSimulator(smpl, betas, gravity=False)
    np.testing.assert_array_equal(simulator.offsets(theta, 60.0), 0)


def test_a_body_at_rest_pose_hangs_as_it_was_scanned(smpl):
    betas = SUBJECTS["female"][0].betas
    theta = np.tile(np.linspace(0, 0.3, 69) * (np.arange(69) >= 66), (4, 1))
    found = TissueSimulator(smpl, betas).offsets(theta, 60.0)
    np.testing.assert_allclose(found, 0, atol=1e-9)


def test_a_body_that_lies_still_hangs_and_stays(smpl):
    """On her back: gravity in her own frame turns from down to back, and flesh follows it."""
    betas = SUBJECTS["female"][0].betas
    theta = np.zeros((20, 69))
    theta[:, 0] = -np.pi / 2
    found = TissueSimulator(smpl, betas).offsets(theta, 60.0)
    belly = np.linalg.norm(found[0], axis=-1).argmax()
    assert 0.003 < np.linalg.norm(found[0, belly]) < 0.05
    # R^T g - g = (0, +g, -g): towards the head and towards the back.
    assert found[0, belly, 1] > 0 > found[0, belly, 2]
    np.testing.assert_allclose(found, found[:1].repeat(20, axis=0), atol=1e-6)


def test_a_falling_body_is_driven_upwards_in_its_own_frame(smpl):
    times_s = np.arange(30) / 60
    theta = np.zeros((30, 69))
    theta[:, 2] = np.pi / 2
    theta[:, 67] = -9.81 * times_s**2 / 2
    everywhere = np.arange(smpl.vertex_count)
    drive = rest_frame_drive(smpl, np.zeros(10), theta, 60.0, everywhere, gravity=False)
    # The body was turned left about z, so the world's y is its own x.
    expected = np.broadcast_to([9.81, 0, 0], drive[2:-2].shape)
    np.testing.assert_allclose(drive[2:-2], expected, atol=1e-8)


def test_in_free_fall_gravity_is_not_felt(smpl):
    """What is left of R^T (g - x'') - g is -g: flesh rises against the posture of the scan."""
    times_s = np.arange(30) / 60
    theta = np.zeros((30, 69))
    theta[:, 2] = np.pi / 2
    theta[:, 67] = -9.81 * times_s**2 / 2
    everywhere = np.arange(smpl.vertex_count)
    drive = rest_frame_drive(smpl, np.zeros(10), theta, 60.0, everywhere)
    expected = np.broadcast_to([0, 9.81, 0], drive[2:-2].shape)
    np.testing.assert_allclose(drive[2:-2], expected, atol=1e-8)


def test_sizes_are_plausible_and_heavier_bodies_move_more(offsets):
    heavy, lean = (np.linalg.norm(part, axis=-1) * 1000 for part in offsets)
    assert heavy[40:].mean() > 1.3 * lean[40:].mean()
    assert 1.0 < heavy[40:].mean() < 5.0
    assert 15 < heavy.max() < 60


def test_offsets_are_smooth_over_the_surface(smpl, offsets):
    faces, peak = smpl.data.faces, offsets[0][np.abs(offsets[0]).max((1, 2)).argmax()]
    edges = smpl.data.v_template[faces[:, 0]] - smpl.data.v_template[faces[:, 1]]
    steps = peak[faces[:, 0]] - peak[faces[:, 1]]
    strain = np.linalg.norm(steps, axis=1) / np.linalg.norm(edges, axis=1)
    assert np.quantile(strain, 0.99) < 0.6
    assert np.linalg.norm(steps, axis=1).max() < 0.02


def test_bony_parts_are_held_and_bellies_are_loose(smpl):
    data, betas = smpl.data, SUBJECTS["female"][0].betas
    looseness = tissue_looseness(data, betas)
    assert looseness[data.weights[:, 15] > 0.9].max() < 0.02
    assert looseness[data.weights[:, [20, 21, 22, 23]].sum(1) > 0.9].max() < 0.02
    assert looseness[data.weights[:, 3] > 0.7].mean() > 0.6


def test_frame_rates_that_do_not_divide_the_steps_are_refused(smpl):
    simulator = TissueSimulator(smpl, np.zeros(10))
    with pytest.raises(ValueError, match="multiple"):
        simulator.offsets(np.zeros((3, 69)), 100.0)
