"""What the law gives beside what is published; each test says the numbers and their source."""

from __future__ import annotations

import numpy as np
import pytest

from bridge.body import load_body_model
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.parts import PARTS, part_weights
from bridge.body.posing import shaped_vertices
from dsnet.synthetic.simulation import TissueSimulator
from dsnet.synthetic.subjects import SUBJECTS
from dsnet.synthetic.tissue_parameters import PRELOAD, SOFT_TISSUE
from tests.dsnet.synthetic.test_soft_tissue import displaced, tissue, vibrate
from tests.pages import ROOT

FPS, FRAMES, STEADY = 120.0, 420, 300
G = 9.81


def in_time(bounce_m):
    """theta (T, 69) of a body that stands upright and moves up and down, beginning softly."""
    start = np.clip(np.arange(len(bounce_m)) / FPS / 1.5, 0, 1)
    theta = np.zeros((len(bounce_m), 69))
    theta[:, 67] = bounce_m * start**2 * (3 - 2 * start)
    return theta


def walking():
    """The trunk goes 45 mm up and down, 1.9 times a second."""
    return in_time(0.0225 * np.sin(2 * np.pi * 1.9 * np.arange(FRAMES) / FPS))


def running():
    """2.7 steps a second, for 40 % of each in the air; on the ground half a sine of force."""
    period_s, fine = 1 / 2.7, 2400
    ground_s, phase_s = 0.6 * period_s, (np.arange(fine) + 0.5) / fine * period_s
    push = G * period_s * np.pi / 2 / ground_s * np.sin(np.pi * phase_s / ground_s)
    acceleration = np.where(phase_s < ground_s, push, 0) - G
    speed = np.cumsum(acceleration) * period_s / fine
    place = np.cumsum(speed - speed.mean()) * period_s / fine
    times_s = np.arange(FRAMES) / FPS
    return in_time(np.interp(times_s, phase_s, place - place.mean(), period=period_s))


def upwards_mm(betas, theta):
    """(T,) of the foremost of the bust, of the thigh's front, and (T, N) of the breastbone."""
    body = load_body_model("embedded:female")
    vertices = shaped_vertices(body, betas[None])[0]
    joint = dict(zip(SMPL_JOINT_NAMES, body.J_regressor @ vertices, strict=True))
    part = dict(zip(PARTS, part_weights(body).T > 0.5, strict=True))
    x, _, z = vertices.T
    bust = np.flatnonzero(part["chest"] & (np.abs(x) > 0.05))
    middle = (joint["left_hip"] + joint["left_knee"]) / 2
    front = np.flatnonzero(part["thighs"] & (z > middle[2]))
    aside = np.linalg.norm(vertices[front, :2] - middle[:2], axis=1)
    bone = np.flatnonzero(part["chest"] & (z > joint["spine3"][2]) & (np.abs(x) < 0.01))
    up_mm = 1e3 * TissueSimulator(body, betas).offsets(theta, FPS)[..., 1]
    return up_mm[:, bust[z[bust].argmax()]], up_mm[:, front[aside.argmin()]], up_mm[:, bone]


@pytest.fixture(scope="module")
def sizes():
    """Peak to peak: by woman, from large to small busts; walking, then running; and place."""
    women = [SUBJECTS["female"][index].betas for index in (0, 2, 3)]
    return np.array(
        [
            [[np.ptp(up_mm[STEADY:], axis=0).max() for up_mm in upwards_mm(betas, motion())]
             for motion in (walking, running)]
            for betas in women
        ]
    )  # fmt: skip


def test_a_large_bust_walks_as_published(sizes):
    """Scurr 2011, D cup, bare: 42 +- 10 mm, half of it vertical."""
    assert 15 < sizes[0, 0, 0] < 30


def test_a_large_bust_runs_farther_than_published(sizes):
    """Scurr 2011, D cup, bare: 152 +- 42 mm, half of it vertical, some 76 +- 21 mm.

    Not met: the law gives 1.8 times as much, for this trunk goes 95 mm up and down near the
    bust's own frequency, while in jumping jacks it gives what markers on a woman say.
    """
    assert 76 - 21 < sizes[0, 1, 0] < 2 * 76
    page = (ROOT / "docs" / "data.md").read_text(encoding="utf-8")
    assert f"{sizes[0, 1, 0] / 76:.1f} times as far in running" in page


def test_motion_of_the_bust_follows_its_size(sizes):
    """Wood 2012: with its mass; from small to large busts two to three times as far."""
    for motion in (0, 1):
        small, middle, large = sizes[::-1, motion, 0]
        assert small < middle < large
        assert 1.5 < large / small < 3.5


def test_thighs_run_as_published_and_breastbones_stand_still(sizes):
    """Thighs of runners 8 to 24 mm peak to peak; skin on the breastbone 0.3 mm."""
    assert 8 < sizes[:, 1, 1].min() < sizes[:, 1, 1].max() < 24
    assert sizes[:, :, 2].max() < 0.3


def test_the_busts_swing_quickens_as_it_fades():
    """Free decay by markers on a woman: 2.7 Hz large, 3.0 to 3.3, then 3.75 to 4.3 Hz small.

    The law rises as far as the frequency at rest alone: the last are not met.
    """
    chest = SOFT_TISSUE["chest"]
    body = tissue(chest.frequency_hz, chest.damping_ratio, preload=PRELOAD)
    x, _ = vibrate(body, displaced(body, [0, 0.06, 0]), 360)
    crossings = np.flatnonzero(np.diff(np.sign(x)))
    hz = 1 / (2 * np.diff(crossings) * body.dt_s)
    above, below = hz[1::2], hz[0::2]  # half swings above and below the rest
    assert above[0] < below[0]
    at_rest = chest.frequency_hz * np.sqrt(1 - chest.damping_ratio**2)
    first = 1 / (2 * crossings[0] * body.dt_s) / 2
    assert first < 0.85 * at_rest
    np.testing.assert_allclose(hz[2:5], at_rest, rtol=0.06)


def test_a_landing_moves_the_thigh_as_far_as_bone_pins_say():
    """Cereatti's data of hops: up to 17 mm. A fall of 10 cm, stopped in 0.1 s."""
    times_s = np.arange(360) / FPS
    fall_s, stop_s = np.sqrt(2 * 0.1 / G), 0.1
    speed = np.sqrt(2 * 0.1 * G)
    start, landed = times_s - 0.5, times_s - 0.5 - fall_s
    force = speed / stop_s * (1 - np.cos(2 * np.pi * np.clip(landed / stop_s, 0, 1)))
    acceleration = np.where(start < 0, 0, np.where(landed < 0, -G, force))
    place = np.cumsum(np.cumsum(acceleration)) / FPS**2
    place -= np.where(landed > stop_s, (landed - stop_s) * (np.diff(place)[-1] * FPS), 0)
    theta = np.zeros((360, 69))
    theta[:, 67] = place
    _, thigh_mm, _ = upwards_mm(np.zeros(10), theta)
    assert 5 < -thigh_mm[int((0.5 + fall_s) * FPS) :].min() < 17
