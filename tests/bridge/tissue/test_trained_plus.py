"""A trained `dsnet_plus`: its arrays, and what it says of known and new people."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bridge.errors import DsnetError
from bridge.tissue.shape import shape_features
from bridge.tissue.trained_plus import (
    NODE_FIELDS,
    StaticPart,
    TrainedPlus,
    Weights,
    shares_of_people,
    static_features,
)
from dsnet.verify.reference.oscillators import coefficients

PEOPLE = np.stack([np.zeros(10), np.full(10, 1.5)]).astype(np.float32)
START = (40.0, 0.2, 500.0, 0.01, 1.3, 1.0, 2e-3, 1.1, 0.9)


@pytest.fixture(scope="module")
def trained(nodes) -> TrainedPlus:
    rng = np.random.default_rng(0)
    base = {
        name: (np.log(value) + 0.1 * rng.normal(size=(80, 1))).astype(np.float32)
        for name, value in zip(NODE_FIELDS, START, strict=True)
    }
    residual = rng.normal(scale=0.2, size=(2, 80, 1)).astype(np.float32)
    slopes = np.array([[-0.3], [0.2], [-0.1]], np.float32)
    power, taps = np.array([1.5], np.float32), np.array([0.5, 0.3, 0.2], np.float32)
    weights = Weights(base, slopes, power, residual, taps)
    static = StaticPart(
        rng.normal(scale=0.002, size=(2, 6890, 3)).astype(np.float32),
        rng.normal(scale=0.002, size=(207, 80, 3)).astype(np.float32),
    )
    return TrainedPlus(nodes, weights, static, PEOPLE, look_ahead=1)


def motion(frames: int = 20) -> np.ndarray:
    rng = np.random.default_rng(1)
    rates = rng.uniform(0.05, 0.3, (1, 69))
    return 0.3 * np.sin(rates * np.arange(frames)[:, None] + rng.uniform(0, 6, (1, 69)))


@pytest.mark.parametrize("steps", [1, 3])
def test_a_model_of_other_steps_is_refused(trained, steps):
    arrays = {**trained.arrays(), "steps": np.array([steps], np.int32)}
    with pytest.raises(DsnetError, match=r"steps a frame; expected 2 steps\. Train it again"):
        TrainedPlus.from_arrays(arrays)


def test_arrays_bring_the_same_model_back(trained, body):
    again = TrainedPlus.from_arrays(trained.arrays())
    assert again.look_ahead == 1
    theta, betas = motion(), np.full(10, 0.4)
    for name, array in trained.arrays().items():
        np.testing.assert_array_equal(again.arrays()[name], array, err_msg=name)
    np.testing.assert_array_equal(
        again.static_m(body, betas, theta), trained.static_m(body, betas, theta)
    )


def test_kernel_gives_known_people_themselves_and_strangers_nobody():
    np.testing.assert_allclose(shares_of_people(PEOPLE[1], PEOPLE), [0, 1], atol=0.02)
    np.testing.assert_allclose(shares_of_people(np.full(10, -9.0), PEOPLE), [0, 0], atol=1e-6)
    between = shares_of_people(np.full(10, 0.75), PEOPLE)
    assert between[0] == pytest.approx(between[1])
    assert 0.1 < between[0] < 0.9


def test_softness_follows_shape_and_known_people_keep_their_own(trained, body, nodes):
    weights, far = trained.weights, np.array([-9.0] + [0.0] * 9)
    features = shape_features(body, far, nodes.vertices)
    stranger = coefficients(trained, body, far)
    expected = np.exp(weights.base["omega"] + features @ weights.slopes)
    np.testing.assert_allclose(stranger.omega, expected, rtol=1e-3)
    known = coefficients(trained, body, PEOPLE[0])
    own = np.exp(weights.base["omega"] + weights.residual[0])
    np.testing.assert_allclose(known.omega, own, rtol=0.01)
    stiffer = weights.base["stiffening"] + 1.5 * weights.residual[0]
    np.testing.assert_allclose(known.stiffening, np.exp(stiffer), rtol=0.02)
    deeper = weights.base["sag"] - 2 * weights.residual[0]
    np.testing.assert_allclose(known.sag, np.exp(deeper), rtol=0.02)
    for name in set(NODE_FIELDS) - {"omega", "stiffening", "sag"}:
        np.testing.assert_allclose(getattr(known, name), np.exp(weights.base[name]), rtol=1e-6)
        np.testing.assert_array_equal(getattr(known, name), getattr(stranger, name))


def test_static_part_is_the_persons_constant_and_the_poses(trained, body, nodes):
    theta = motion(4)
    known = trained.static_m(body, PEOPLE[1], theta)
    by_pose = np.tensordot(static_features(body, theta), trained.static.by_pose_m, 1)
    expected = trained.static.constant_m[1] + nodes.spread(by_pose)
    np.testing.assert_allclose(known, expected, atol=1e-6)
    stranger = trained.static_m(body, np.full(10, 0.7), theta)
    np.testing.assert_allclose(stranger, nodes.spread(by_pose), atol=1e-6)
    np.testing.assert_array_equal(static_features(body, np.zeros((1, 69))), 0.0)


def test_a_stranger_has_none_where_only_constants_were_found(trained, body):
    constant = StaticPart(trained.static.constant_m, np.zeros((207, 80, 3), np.float32))
    model = replace(trained, static=constant)
    assert model.static_m(body, PEOPLE[0], motion(3)) is not None
    assert model.static_m(body, np.full(10, 0.7), motion(3)) is None
    nothing = StaticPart(0 * constant.constant_m, constant.by_pose_m)
    assert replace(trained, static=nothing).static_m(body, PEOPLE[0], motion(3)) is None


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"taps": None}, "no 'taps'"),
        ({"log_sag": None}, r"no 'log_sag'; expected all of its arrays\. Train it again"),
        ({"nodes/vertices": np.full(80, 6890, np.int32)}, "'nodes/vertices' that point outside"),
        ({"nodes/owners": np.full((6890, 8), -1, np.int32)}, "'nodes/owners' that point outside"),
        ({"nodes/edges": np.full((5, 2), 80, np.int32)}, "'nodes/edges' that|'nodes/pulls_m2' of"),
        ({"look_ahead": np.array([10**9])}, "'look_ahead' that point outside"),
        ({"residual": np.zeros((3, 80, 1))}, "'residual' of shape"),
        ({"log_omega": np.full((80, 1), np.nan)}, "'log_omega' of shape"),
        ({"steps": np.array([np.nan])}, "'steps' of shape"),
        ({"steps": None}, "no 'steps'"),
    ],
)
def test_arrays_that_do_not_fit_together_are_refused(trained, change, complaint) -> None:
    changed = {name: a for name, a in {**trained.arrays(), **change}.items() if a is not None}
    with pytest.raises(DsnetError, match=complaint):
        TrainedPlus.from_arrays(changed)
