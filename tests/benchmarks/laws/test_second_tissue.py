"""The second law against closed forms: frequency and decay by direction, energy, settling."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from benchmarks.laws.second_tissue import FleshLayer, LayerParameters, LayerState
from tests.dsnet.synthetic.test_soft_tissue import patch

NORMAL_RATIO, RATE_HZ = 2.0, 120.0
ALONG, ACROSS = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


def layer(frequency_hz=4.0, rate_hz=RATE_HZ, held=None, **changes):
    vertices, faces = patch()
    count = len(vertices)
    parameters = LayerParameters(
        frequency_hz=np.full(count, frequency_hz),
        thickness_m=np.full(count, 0.05),
        normals=np.tile(ACROSS, (count, 1)),
        relaxation_s=np.full(count, 0.04),
        bending_m4_s2=np.full(count, 0.004),
        free=np.ones(count, bool) if held is None else ~held(vertices),
        normal_ratio=NORMAL_RATIO,
    )
    return FleshLayer(vertices, faces, replace(parameters, **changes), rate_hz)


def displaced(body, offsets_m):
    offsets_m = np.broadcast_to(offsets_m, (len(body.free), 3)).astype(float)
    return LayerState(offsets_m, np.zeros_like(offsets_m), np.zeros_like(offsets_m))


def states(body, state, steps, load=(0.0, 0.0, 0.0)):
    """The state before and after every step."""
    loads = np.tile(load, (len(body.free), 1))
    result = [state]
    for _ in range(steps):
        result.append(body.step(result[-1], (loads, loads)))
    return result


def zener(frequency_hz, share, relaxation_s, times_s):
    """x of x'' + w^2 x + q = 0, q' = r w^2 x' - q / t, released at 1: its matrix exponential."""
    squared = (2 * np.pi * frequency_hz) ** 2
    matrix = np.array([[0, 1, 0], [-squared, 0, -1], [0, share * squared, -1 / relaxation_s]])
    return np.array([expm(matrix * time_s)[0, 0] for time_s in times_s])


@pytest.mark.parametrize(("direction", "stiffer"), [(ALONG, 1.0), (ACROSS, NORMAL_RATIO)])
@pytest.mark.parametrize("frequency_hz", [3.5, 7.0])
def test_a_small_vibration_is_that_of_the_standard_linear_solid(direction, stiffer, frequency_hz):
    body = layer(frequency_hz, element_share=0.5)
    moving = states(body, displaced(body, 1e-4 * direction), 240)
    found = np.array([state.offsets_m[0] @ direction for state in moving]) / 1e-4
    times_s = np.arange(241) / RATE_HZ
    # Along the normal the spring is stiffer, the element is not.
    share = 0.5 / stiffer
    expected = zener(frequency_hz * np.sqrt(stiffer), share, 0.04, times_s)
    np.testing.assert_allclose(found, expected, atol=0.03 * (frequency_hz / 3.5) ** 2)
    assert 0.001 < np.abs(expected[-60:]).max() < 0.5


def test_the_method_is_of_second_order():
    errors = []
    for rate_hz in (120.0, 240.0):
        body = layer(6.0, rate_hz)
        moving = states(body, displaced(body, 1e-4 * ALONG), int(rate_hz / 4))
        expected = zener(6.0, 0.5, 0.04, [0.25])[0]
        errors.append(abs(moving[-1].offsets_m[0, 0] / 1e-4 - expected))
    np.testing.assert_allclose(errors[0] / errors[1], 4, rtol=0.2)


def test_without_the_element_the_method_hardly_damps():
    body = layer(4.0, element_share=1e-9)
    moving = states(body, displaced(body, 0.002 * ALONG), 120)
    kept = body.energy(moving[-1]) / body.energy(moving[0])
    assert 0.9 < kept < 1


@pytest.mark.parametrize("amplitude_m", [0.001, 0.005])
def test_energy_never_grows_without_load(amplitude_m):
    energy = released_energy(amplitude_m)
    assert np.diff(energy).max() <= 0
    assert energy[-1] < 0.1 * energy[0]


@pytest.mark.parametrize("amplitude_m", [0.05, 0.3])
def test_far_beyond_the_layers_thickness_it_never_grows_over_a_vibration(amplitude_m):
    energy = released_energy(amplitude_m)
    assert (energy[12:] < energy[:-12]).all()
    assert energy.max() == energy[0]


def released_energy(amplitude_m):
    """Of 60 steps from random offsets."""
    body = layer(10.0)
    rough = np.random.default_rng(0).normal(size=(len(body.free), 3)) * amplitude_m
    return np.array([body.energy(state) for state in states(body, displaced(body, rough), 60)])


def test_energy_is_the_work_of_the_load():
    """Pushed slowly, tissue stores what the push did: E = integral of f du."""
    body = layer(relaxation_s=np.full(64, 1e-6))
    pushes = np.linspace(0, 60, 241)
    direction = np.array([0.6, 0.0, 0.8])
    settled = [body.settled(np.tile(push * direction, (64, 1))) for push in pushes]
    way = np.array([state.offsets_m[0] @ direction for state in settled])
    work = ((pushes[1:] + pushes[:-1]) / 2 * np.diff(way)).sum() * 0.01
    np.testing.assert_allclose(body.energy(settled[-1]), work, rtol=1e-4)


def test_no_load_gives_exactly_no_offset():
    body = layer()
    last = states(body, body.at_rest(), 20)[-1]
    np.testing.assert_array_equal(last.offsets_m, 0.0)
    np.testing.assert_array_equal(last.velocities_m_s, 0.0)


@pytest.mark.parametrize("tension", [1.0, 1.6])
def test_a_constant_load_settles_where_springs_and_load_balance(tension):
    body = layer(5.0, fibre_gain=1.5, fibre_strain=0.3)
    load = np.tile([20.0, 0.0, 15.0], (len(body.free), 1))
    state = body.at_rest()
    for _ in range(2400):
        state = body.step(state, (load, load), tension)
    x, _, z = state.offsets_m.T
    squared = (x**2 + NORMAL_RATIO * z**2) / 0.05**2
    spring = tension * (2 * np.pi * 5) ** 2 * (1 + 1.5 * squared / (squared + 0.3**2))
    np.testing.assert_allclose(spring * x, 20.0, rtol=1e-4)
    np.testing.assert_allclose(spring * NORMAL_RATIO * z, 15.0, rtol=1e-4)
    np.testing.assert_allclose(state.element_m_s2, 0, atol=1e-4)
    settled = body.settled(load, tension)
    np.testing.assert_allclose(state.offsets_m, settled.offsets_m, atol=1e-7)


def test_what_is_settled_stays():
    body = layer(held=lambda vertices: vertices[:, 0] < 0.03)
    load = np.random.default_rng(0).normal(size=(len(body.free), 3)) * 9.81
    settled = body.settled(load)
    after = settled
    for _ in range(10):
        after = body.step(after, (load, load))
    np.testing.assert_allclose(after.offsets_m, settled.offsets_m, atol=1e-9)


def test_held_vertices_do_not_move_and_hold_their_neighbours():
    body = layer(held=lambda vertices: vertices[:, 0] < 0.03)
    vertices, _ = patch()
    moving = states(body, body.at_rest(), 30, load=(10.0, 0.0, 0.0))[-1]
    reach, x = moving.offsets_m[:, 0], vertices[body.free, 0]
    assert reach[x < 0.05].max() < 0.6 * reach[x > 0.09].min()


def test_violence_stays_finite_and_bounded():
    body = layer(12.0)
    draw, state = np.random.default_rng(0), body.at_rest()
    for _ in range(2000):
        load = np.tile(draw.normal(size=3) * 2000, (len(body.free), 1))
        state = body.step(state, (load, load), 1 + 0.6 * draw.random())
        assert np.abs(state.offsets_m).max() < 2.0
