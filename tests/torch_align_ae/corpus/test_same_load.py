"""What the predictor says that tissue feels is what drives the simulated tissue."""

from __future__ import annotations

import numpy as np

from bridge.body import load_body_model
from bridge.tissue.oscillators import node_loads
from torch_align_ae.corpus.simulation import body_in_double, rest_frame_drive


def test_predictor_and_simulator_feel_the_same_but_for_blunted_impacts():
    rng = np.random.default_rng(0)
    rates, phases = rng.uniform(0.05, 0.3, (1, 69)), rng.uniform(0, 2 * np.pi, (1, 69))
    theta = 0.4 * np.sin(rates * np.arange(30)[:, None] + phases)
    body, betas, skin = (
        load_body_model("embedded:female"),
        np.linspace(-2, 2, 10),
        np.arange(0, 6890, 30),
    )
    load = node_loads(body, skin, betas, theta, 60.0)
    felt = load.inertia + load.gravity
    blunted = felt.copy()
    blunted[1:-1] = (felt[:-2] + 2 * felt[1:-1] + felt[2:]) / 4
    drive = rest_frame_drive(body_in_double(body), betas, theta, 60.0, skin)
    np.testing.assert_allclose(blunted, drive, atol=1e-4)
    assert drive.std() > 3.0
