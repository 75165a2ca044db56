"""Where flesh is soft, where skin lies on bone, and the table of constants on the page."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from bridge.body import load_body_model
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.parts import PARTS, part_weights
from bridge.body.posing import shaped_vertices
from bridge.body.surface_operators import cotangent_laplacian, vertex_areas_m2
from dsnet.synthetic.subjects import SUBJECTS, UNSEEN
from dsnet.synthetic.tissue_parameters import (
    FIRMEST_HZ,
    MENS_SOFT_TISSUE,
    PRELOAD,
    SOFT_TISSUE,
    WAVE_SPEED_M_S,
    tissue_depth_m,
    tissue_parameters,
)
from tests.sources import ROOT

WOMEN, MEN = (
    {"mean": np.zeros(10)} | {s.name: s.betas for s in (*SUBJECTS[gender], *UNSEEN[gender])}
    for gender in ("female", "male")
)


def person(gender, betas):
    body = load_body_model(f"embedded:{gender}")
    return body, shaped_vertices(body, betas[None])[0], tissue_parameters(body, betas)


def of_part(body, name):
    return part_weights(body)[:, PARTS.index(name)]


def in_place_hz(body, vertices, parameters):
    """(V,) of a lone spring that gives to the same even pull as the coupled skin; NaN on bone."""
    free = np.flatnonzero(parameters.free)
    mass = vertex_areas_m2(vertices, body.faces)[free]
    springs = sp.diags(mass * (2 * np.pi * parameters.frequency_hz[free]) ** 2)
    laplacian = cotangent_laplacian(vertices, body.faces)[free][:, free]
    coupled = springs + parameters.wave_speed_m_s**2 * laplacian
    hz = np.full(len(vertices), np.nan)
    hz[free] = 1 / np.sqrt(splu(coupled.tocsc()).solve(mass)) / (2 * np.pi)
    return hz


def softest_chest_hz(gender, betas):
    body, vertices, parameters = person(gender, betas)
    return np.nanmin(in_place_hz(body, vertices, parameters)[of_part(body, "chest") > 0.5])


def test_womens_busts_swing_as_measured_and_big_ones_slower():
    """3.2 to 4 Hz (most at 4 Hz, Chen, Ng, Yu 2013; 3.6 Hz by markers); with depth where it is."""
    found = {}
    for name, betas in WOMEN.items():
        body, vertices, _ = person("female", betas)
        depth_m = tissue_depth_m(body, vertices)[of_part(body, "chest") > 0.5].max()
        found[name] = depth_m, softest_chest_hz("female", betas)
    depth_m, hz = np.array(list(found.values())).T
    full = depth_m > 0.045
    assert full.sum() >= 5
    assert hz[full].min() > 3.15
    assert hz[full].max() < 4.05
    assert hz.max() < 4.6
    assert np.corrcoef(depth_m, hz)[0, 1] < -0.9


def test_mens_chests_are_firmer_than_womens():
    assert softest_chest_hz("male", np.zeros(10)) > 1.15 * softest_chest_hz("female", np.zeros(10))
    firm = []
    for gender in ("female", "male"):
        body, vertices, parameters = person(gender, np.zeros(10))
        hz = in_place_hz(body, vertices, parameters)
        firm.append(np.nanmedian(hz[of_part(body, "chest") > 0.7]))
    assert firm[1] > 1.35 * firm[0]


@pytest.mark.parametrize("gender", ["female", "male"])
@pytest.mark.parametrize("kind", ["mean", "heavy", "lean"])
def test_skull_breastbone_shins_hands_and_feet_are_bone(gender, kind):
    people = WOMEN if gender == "female" else MEN
    betas = list(people.values())[{"mean": 0, "heavy": 1, "lean": 5}[kind]]
    body, vertices, parameters = person(gender, betas)
    held, joints = ~parameters.free, body.J_regressor @ vertices
    joint: dict[str, NDArray] = dict(zip(SMPL_JOINT_NAMES, joints, strict=True))
    for name in ("head", "hands", "feet"):
        assert held[of_part(body, name) > 0.9].all(), name
    x, y, z = vertices.T
    trunk = of_part(body, "chest") + of_part(body, "belly") > 0.9
    xiphoid = 0.7 * joint["spine2"][1] + 0.3 * joint["spine3"][1]
    breastbone = trunk & (np.abs(x) < 0.01) & (y > xiphoid) & (z > 0)
    assert breastbone.sum() > 3
    assert held[breastbone].all()
    leg = of_part(body, "calves") > 0.9
    for side in ("left", "right"):
        knee, ankle = joint[f"{side}_knee"], joint[f"{side}_ankle"]
        below = (y < 0.75 * knee[1] + 0.25 * ankle[1]) & (y > 0.25 * knee[1] + 0.75 * ankle[1])
        share = (y - ankle[1]) / (knee[1] - ankle[1])
        middle = ankle + share[:, None] * (knee - ankle)
        near = leg & below & (np.sign(x) == np.sign(knee[0]))
        before = near & (z - middle[:, 2] > 4 * np.abs(x - middle[:, 0]))
        behind = near & (middle[:, 2] - z > 4 * np.abs(x - middle[:, 0]))
        assert before.sum() > 2
        assert held[before].all()
        assert not held[behind].any()
    for name in ("belly", "buttocks", "thighs", "upper_arms"):
        assert held[of_part(body, name) > 0.9].mean() < 0.12, name


def test_flesh_of_one_part_hangs_by_the_same_share_of_its_depth():
    body, vertices, parameters = person("female", WOMEN["50004"])
    inside = (of_part(body, "thighs") > 0.999) & (parameters.frequency_hz < 0.99 * FIRMEST_HZ)
    depth_m = tissue_depth_m(body, vertices)[inside]
    assert np.ptp(depth_m) > 0.03
    constant = parameters.frequency_hz[inside] ** 2 * depth_m
    expected = SOFT_TISSUE["thighs"].frequency_hz ** 2 * SOFT_TISSUE["thighs"].depth_m
    np.testing.assert_allclose(constant, expected, rtol=1e-3)


def test_left_and_right_are_alike_where_the_body_is():
    _, vertices, parameters = person("female", np.zeros(10))
    mirrored = vertices * [-1, 1, 1]
    apart = np.linalg.norm(vertices[:, None, ::2] - mirrored[None, ::40, ::2], axis=2)
    apart = np.hypot(apart, vertices[:, None, 1] - mirrored[None, ::40, 1])
    pairs, there = apart.argmin(axis=0), apart.min(axis=0) < 0.004
    assert there.sum() > 50
    one, other = parameters.frequency_hz[::40][there], parameters.frequency_hz[pairs[there]]
    assert np.median(np.abs(np.log(one / other))) < 0.1


def test_the_page_shows_the_table():
    page = (ROOT / "docs" / "data.md").read_text(encoding="utf-8")
    rows = {name.replace("_", " "): flesh for name, flesh in SOFT_TISSUE.items()}
    rows |= {f"{name}, men": flesh for name, flesh in MENS_SOFT_TISSUE.items()}
    for name, (hz, depth_m, damping, source) in rows.items():
        assert f"| {name} | {hz:g} | {1e3 * depth_m:g} | {damping:g} | {source} |" in page
    words = " ".join(page.split())
    assert f"preload {PRELOAD:g}" in words
    assert f"wave speed {WAVE_SPEED_M_S:g} m/s" in words
    assert f"firmest {FIRMEST_HZ:g} Hz" in words
