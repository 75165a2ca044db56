"""What drives the simulated tissue."""

from __future__ import annotations

import numpy as np
import pytest

from bridge.body import load_body_model
from bridge.tissue.oscillators import node_loads
from dsnet.synthetic.simulation import TissueSimulator
from dsnet.synthetic.subjects import SUBJECTS


@pytest.mark.parametrize("gravity", [True, False])
def test_a_body_that_stands_still_has_no_offsets(body, gravity):
    """Upright under gravity, in any pose without it; R^T g - g itself is rounded."""
    betas, pose = SUBJECTS["female"][0].betas, np.zeros(69) if gravity else np.linspace(0, 0.3, 69)
    simulator = TissueSimulator(body, betas, gravity=gravity)
    offsets_m = simulator.offsets(np.tile(pose, (10, 1)), 60.0)
    np.testing.assert_allclose(offsets_m, 0, atol=1e-15 if gravity else 0)


@pytest.mark.parametrize(("gravity", "felt"), [(False, [9.81, 0, 0]), (True, [0, 9.81, 0])])
def test_a_falling_body_is_driven_upwards_in_its_own_frame(body, gravity, felt):
    """Turned left about z, so the world's y is its own x; R^T (g - x'') - g leaves -g alone."""
    times_s = np.arange(30) / 60
    theta = np.zeros((30, 69))
    theta[:, 2] = np.pi / 2
    theta[:, 67] = -9.81 * times_s**2 / 2
    drive = TissueSimulator(body, np.zeros(10), gravity=gravity).drive(theta, 60.0)
    assert drive.shape[1] > 1000
    expected = np.broadcast_to(felt, drive[2:-2].shape)
    np.testing.assert_allclose(drive[2:-2], expected, atol=1e-8)


def test_frame_rates_that_do_not_divide_the_steps_are_refused(body):
    simulator = TissueSimulator(body, np.zeros(10))
    with pytest.raises(ValueError, match="multiple"):
        simulator.offsets(np.zeros((3, 69)), 100.0)


def test_predictor_and_simulator_feel_the_same_but_for_blunted_impacts():
    rng = np.random.default_rng(0)
    rates, phases = rng.uniform(0.05, 0.3, (1, 69)), rng.uniform(0, 2 * np.pi, (1, 69))
    theta = 0.4 * np.sin(rates * np.arange(30)[:, None] + phases)
    body, betas = load_body_model("embedded:female"), np.linspace(-2, 2, 10)
    simulator = TissueSimulator(body, betas)
    load = node_loads(body, simulator.tissue.free[::30], betas, theta, 60.0)
    felt = load.inertia + load.gravity
    blunted = felt.copy()
    blunted[1:-1] = (felt[:-2] + 2 * felt[1:-1] + felt[2:]) / 4
    drive = simulator.drive(theta, 60.0)[:, ::30]
    np.testing.assert_allclose(blunted, drive, atol=1e-4)
    assert drive.std() > 3.0
