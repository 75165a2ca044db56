"""A known law is found again from what it made; on its own past it stays bounded."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.systems.autoregression import (
    DECAYING,
    Autoregression,
    DrivenClip,
    OneStepFit,
)

DIM, INPUTS = 4, 3
SHAPES = (-1.0, 0.2, 1.5)


def oscillators(radius: float, seed: int = 0) -> Autoregression:
    """Coupled damped oscillators whose frequencies and answers depend on the shape."""
    rng = np.random.default_rng(seed)
    basis = rng.normal(size=(DIM, DIM))
    angles = rng.uniform(0.1, 0.6, DIM)

    def law(shape: float) -> NDArray:
        first = basis @ np.diag(2 * radius * np.cos(angles + 0.03 * shape)) @ np.linalg.inv(basis)
        return np.concatenate([first.T, -(radius**2) * np.eye(DIM)])

    # Linear in the shape, as the law is: through its values at 0 and 1.
    past = np.stack([law(0.0), law(1.0) - law(0.0)])
    rest = rng.normal(size=(2, INPUTS + 1, DIM)) * np.array([1.0, 0.3])[:, None, None]
    return Autoregression(np.concatenate([past, rest], axis=1))


def clips(law: Autoregression, frames: int = 120, seed: int = 1) -> list[DrivenClip]:
    """What the law makes of random drivers."""
    rng = np.random.default_rng(seed)
    drivers = [rng.normal(size=(frames, INPUTS)) for _ in SHAPES]
    pairs = zip(drivers, SHAPES, strict=True)
    return [DrivenClip(x, law.roll(x, shape), shape) for x, shape in pairs]


def test_rolling_is_the_law_frame_by_frame():
    law = oscillators(0.95)
    driver = np.random.default_rng(5).normal(size=(6, INPUTS))
    found = law.roll(driver, 0.7)
    blocks = np.split(law.weights[0] + 0.7 * law.weights[1], [DIM, 2 * DIM, 2 * DIM + INPUTS])
    first, second, into, constant = blocks
    one, two = np.zeros(DIM), np.zeros(DIM)
    for frame, x in enumerate(driver):
        one, two = one @ first + two @ second + x @ into + constant[0], one
        np.testing.assert_allclose(found[frame], one, rtol=1e-12)


def test_a_known_law_is_found_from_its_own_motion_and_rolls_on_elsewhere():
    truth = oscillators(0.95)
    found = OneStepFit(clips(truth)).with_ridge(1e-12)
    np.testing.assert_allclose(found.weights, truth.weights, atol=1e-6)
    for clip in clips(truth, seed=2):
        rolled = found.roll(clip.driver, clip.shape)
        np.testing.assert_allclose(rolled, clip.state, atol=1e-5 * np.abs(clip.state).max())


def test_a_ridge_shrinks():
    fit = OneStepFit(clips(oscillators(0.95)))
    sizes = [np.linalg.norm(fit.with_ridge(ridge).weights) for ridge in (1e-9, 1e2, 1e6)]
    assert sizes[0] > 1.2 * sizes[1] > 100 * sizes[2]


def test_one_person_leaves_what_depends_on_the_shape_at_zero():
    truth = oscillators(0.9)
    only = [DrivenClip(c.driver, truth.roll(c.driver, 0.0), 0.0) for c in clips(truth)]
    found = OneStepFit(only).with_ridge(1e-12)
    np.testing.assert_allclose(found.weights[0], truth.weights[0], atol=1e-6)
    assert not found.weights[1].any()


def test_frames_without_two_before_them_add_nothing():
    law = oscillators(0.9)
    long = clips(law)
    short = [DrivenClip(np.ones((t, INPUTS)), np.ones((t, DIM)), 0.3) for t in (1, 2)]
    one, other = (OneStepFit(part).with_ridge(1e-6).weights for part in (long, [*short, *long]))
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("radius", [0.5, 0.97, 1.04])
def test_the_spectral_radius_is_the_growth_of_a_free_mode(radius):
    law = oscillators(radius)
    assert law.spectral_radius(0.0) == pytest.approx(radius)
    state = [np.zeros(DIM), np.random.default_rng(4).normal(size=DIM)]
    for _ in range(400):
        state.append(state[-1] @ law.weights[0, :DIM] + state[-2] @ law.weights[0, DIM : 2 * DIM])
    envelope = [np.linalg.norm(state[at : at + 100], axis=1).max() for at in (100, 300)]
    assert (envelope[1] / envelope[0]) ** (1 / 200) == pytest.approx(radius, abs=3e-3)


def test_a_law_that_would_grow_is_damped_at_every_shape_and_keeps_its_frequencies():
    growing = oscillators(1.04)
    calm = growing.made_to_decay(-1.0, 1.5)
    for shape in np.linspace(-1.0, 1.5, 101):  # known ones and those between
        assert calm.spectral_radius(shape) <= DECAYING + 1e-6
    assert max(calm.spectral_radius(s) for s in SHAPES) > 0.98
    np.testing.assert_array_equal(calm.weights[:, 2 * DIM :], growing.weights[:, 2 * DIM :])

    def angles(law: Autoregression) -> NDArray:
        first, second = law.weights[0, :DIM].T, law.weights[0, DIM : 2 * DIM].T
        companion = np.block([[first, second], [np.eye(DIM), np.zeros((DIM, DIM))]])
        return np.sort(np.angle(np.linalg.eigvals(companion)))

    np.testing.assert_allclose(angles(calm), angles(growing), atol=1e-9)
    rolled = calm.roll(np.random.default_rng(6).normal(size=(3000, INPUTS)), 1.5)
    assert np.abs(rolled[-300:]).max() < 3 * np.abs(rolled[:300]).max()


def test_a_law_that_grows_only_between_two_people_is_damped_too():
    """Of two matrices with all eigenvalues 0, the mean can have one above 1."""
    weights = np.zeros((2, 2 + 2 + 1, 2))
    one, other = np.array([[0.0, 3.0], [0.0, 0.0]]), np.array([[0.0, 0.0], [3.0, 0.0]])
    weights[0, :2], weights[1, :2] = (one + other) / 2, (other - one) / 2
    law = Autoregression(weights)
    found = [law.spectral_radius(s) for s in (-1.0, 0.0, 1.0)]
    np.testing.assert_allclose(found, [0.0, 1.5, 0.0], atol=1e-6)
    calm = law.made_to_decay(-1.0, 1.0)
    assert max(calm.spectral_radius(s) for s in np.linspace(-1, 1, 101)) <= DECAYING + 1e-9


def test_a_law_that_decays_is_left_alone():
    law = oscillators(0.95)
    assert law.made_to_decay(-1.0, 1.5) is law
