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
def test_a_small_vibration_is_that_of_the_standard_linear_solid(direction, stiffer):
    frequency_hz = 3.5
    body = layer(frequency_hz, element_share=0.5)
    moving = states(body, displaced(body, 1e-4 * direction), 240)
    found = np.array([state.offsets_m[0] @ direction for state in moving]) / 1e-4
    times_s = np.arange(241) / RATE_HZ
    # Along the normal the spring is stiffer, the element is not.
    share = 0.5 / stiffer
    expected = zener(frequency_hz * np.sqrt(stiffer), share, 0.04, times_s)
    np.testing.assert_allclose(found, expected, atol=0.03)
    assert 0.001 < np.abs(expected[-60:]).max() < 0.5


@pytest.mark.parametrize("amplitude_m", [0.001, 0.005])
def test_energy_never_grows_without_load(amplitude_m):
    energy = released_energy(amplitude_m)
    assert np.diff(energy).max() <= 0
    assert energy[-1] < 0.1 * energy[0]


def released_energy(amplitude_m):
    """Of 60 steps from random offsets."""
    body = layer(10.0)
    rough = np.random.default_rng(0).normal(size=(len(body.free), 3)) * amplitude_m
    return np.array([body.energy(state) for state in states(body, displaced(body, rough), 60)])
