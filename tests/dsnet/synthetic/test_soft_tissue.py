"""The physics against closed forms: frequency, decay, energy, how flesh hangs."""

from __future__ import annotations

import numpy as np
import pytest

from bridge.body.surface_operators import cotangent_laplacian, vertex_areas_m2
from dsnet.synthetic.soft_tissue import SoftTissue, TissueParameters, TissueState


def patch(side=8, size_m=0.1):
    """A square sheet of side x side vertices."""
    grid = np.linspace(0, size_m, side)
    x, y = np.meshgrid(grid, grid, indexing="ij")
    index = np.arange(side * side).reshape(side, side)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate(
        [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    )
    return np.stack([x, y, 0 * x], -1).reshape(-1, 3), faces


def tissue(frequency_hz=4.0, damping=0.1, preload=1.0, wave_speed=0.7, rate_hz=240.0):
    vertices, faces = patch()
    count = len(vertices)
    parameters = TissueParameters(
        frequency_hz=np.full(count, frequency_hz),
        damping_ratio=np.full(count, damping),
        preload=preload,
        wave_speed_m_s=wave_speed,
        free=np.ones(count, bool),
    )
    return SoftTissue(vertices, faces, parameters, rate_hz)


def displaced(body, offsets_m):
    offsets_m = np.broadcast_to(offsets_m, (len(body.free), 3)).astype(float)
    return TissueState(offsets_m, np.zeros_like(offsets_m), np.zeros_like(offsets_m))


def energy_of(body, state):
    """Kinetic and elastic energy, per unit of surface density."""
    offsets_m, speed = state.offsets_m, state.velocities_m_s
    kinetic = (body._mass * speed**2).sum() / 2
    linear = (offsets_m * (body._stiffness @ offsets_m)).sum() / 2
    quartic = (body._hardening * body._strain(offsets_m) ** 2).sum() / 4
    return float(kinetic + linear + quartic)


def vibrate(body, state, steps, axis=1):
    """One coordinate of the first vertex, and the energy, at every step."""
    silence = np.zeros_like(state.offsets_m)
    x, energy = [state.offsets_m[0, axis]], [energy_of(body, state)]
    for _ in range(steps):
        state = body.step(state, silence)
        x.append(state.offsets_m[0, axis])
        energy.append(energy_of(body, state))
    return np.array(x), np.array(energy)


def period_s(x, dt_s):
    """Mean time between downward zero crossings, interpolated."""
    before = np.flatnonzero((x[:-1] > 0) & (x[1:] <= 0))
    crossings = before + x[before] / (x[before] - x[before + 1])
    return np.diff(crossings).mean() * dt_s


@pytest.mark.parametrize("preload", [1.0, 2.0])
@pytest.mark.parametrize("frequency_hz", [3.5, 8.0])
def test_a_small_swing_has_the_frequency_and_decay_of_a_damped_oscillator(frequency_hz, preload):
    body = tissue(frequency_hz, damping=0.1, preload=preload)
    start_m = 0.01 if preload == 1 else 1e-5
    x, _ = vibrate(body, displaced(body, [0, start_m, 0]), 480)
    omega = 2 * np.pi * frequency_hz
    damped = omega * np.sqrt(1 - 0.1**2)
    times_s = np.arange(481) * body.dt_s
    expected = (
        start_m
        * np.exp(-0.1 * omega * times_s)
        * (np.cos(damped * times_s) + 0.1 * omega / damped * np.sin(damped * times_s))
    )
    np.testing.assert_allclose(period_s(x, body.dt_s), 2 * np.pi / damped, rtol=0.005)
    np.testing.assert_allclose(x, expected, atol=start_m * 0.03)


def test_sidewards_hanging_flesh_is_a_pendulum_of_the_length_of_its_sag():
    body = tissue(frequency_hz=4.0, damping=0.0, preload=2.0)
    x, _ = vibrate(body, displaced(body, [1e-5, 0, 0]), 960, axis=0)
    sag_m = 2.0 * 9.81 / (2 * np.pi * 4.0) ** 2
    np.testing.assert_allclose(period_s(x, body.dt_s), 2 * np.pi * np.sqrt(sag_m / 9.81), rtol=2e-3)


def test_the_rule_itself_does_not_damp():
    body = tissue(damping=0.0, preload=2.0)
    _, energy = vibrate(body, displaced(body, [0.04, 0.0, 0.01]), 2400)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-3)


@pytest.mark.parametrize("amplitude_m", [0.001, 0.05, 0.3])
def test_energy_never_grows_without_drive(amplitude_m):
    body = tissue(frequency_hz=3.6, damping=0.05, preload=2.0)
    rough = np.random.default_rng(0).normal(size=(len(body.free), 3)) * amplitude_m
    _, energy = vibrate(body, displaced(body, rough), 60)
    assert np.diff(energy).max() <= 0
    assert energy[-1] < 0.8 * energy[0]


@pytest.mark.parametrize("amplitude_m", [0.005, 0.02, 0.06])
def test_a_swing_takes_the_time_that_its_potential_says(amplitude_m):
    """Released above the rest; the half period by quadrature of v'' = g - w^2 (1 + a v^2) v."""
    frequency_hz, preload = 3.6, 2.0
    body = tissue(frequency_hz, damping=0.0, preload=preload, rate_hz=960.0)
    x, _ = vibrate(body, displaced(body, [0, amplitude_m, 0]), 4000)
    sag_m = preload * 9.81 / (2 * np.pi * frequency_hz) ** 2
    stiffening = (preload - 1) / (3 - preload) / sag_m**2
    squared = 9.81 / sag_m / (1 + stiffening * sag_m**2)

    def potential(u):
        v = u - sag_m
        return squared * (v**2 / 2 + stiffening * v**4 / 4) + 9.81 * v

    lower = [r.real for r in _turning_points(potential, amplitude_m) if abs(r.imag) < 1e-9]
    lowest = max(root for root in lower if root < 0)
    # u = middle + half cos(angle) takes the root's singularities away.
    angle = (np.arange(4000) + 0.5) / 4000 * np.pi
    half = (amplitude_m - lowest) / 2
    u = (amplitude_m + lowest) / 2 + half * np.cos(angle)
    speed = np.sqrt(2 * (potential(amplitude_m) - potential(u)))
    exact_s = 2 * (half * np.sin(angle) / speed).mean() * np.pi
    np.testing.assert_allclose(period_s(x, body.dt_s), exact_s, rtol=0.003)


def _turning_points(potential, start_m):
    grid = np.linspace(-0.2, 0.2, 5)
    return np.roots(np.polyfit(grid, potential(grid) - potential(start_m), 4))


@pytest.mark.parametrize("amplitude_m", [0.01, 0.3])
def test_released_tissue_comes_to_rest_where_it_began(amplitude_m):
    body = tissue(damping=0.5, preload=2.0)
    rough = np.random.default_rng(0).normal(size=(len(body.free), 3)) * amplitude_m
    state, silence = displaced(body, rough), np.zeros_like(rough)
    for _ in range(1200):
        state = body.step(state, silence)
    # exp(-0.5 * 2 pi 4 Hz * 5 s) of what it was; stiffer springs decay faster.
    np.testing.assert_allclose(state.offsets_m, 0.0, atol=1e-20 * amplitude_m)


@pytest.mark.parametrize("along", [[4.0, -20.0, 0.0], [0.0, 9.81, 0.0]], ids=["load", "fall"])
def test_a_constant_drive_settles_where_spring_and_drive_balance(along):
    """In free fall, which takes gravity off, in the shape without weight."""
    body = tissue(frequency_hz=5.0, damping=0.5, preload=2.0)
    state, drive = displaced(body, 0.0), np.tile(along, (len(body.free), 1))
    for _ in range(1200):
        state = body.step(state, drive)
    np.testing.assert_allclose(state.offsets_m, body.settled(drive).offsets_m, rtol=1e-6, atol=1e-9)
    squared, sag_m = (2 * np.pi * 5) ** 2 / 4, 2 * 9.81 / (2 * np.pi * 5) ** 2
    v = state.offsets_m - [0, sag_m, 0]
    force = squared * (1 + (v**2).sum(1, keepdims=True) / sag_m**2) * v
    np.testing.assert_allclose(force, drive - [0.0, 9.81, 0.0], atol=1e-3)


def test_vertices_that_are_held_do_not_move_and_hold_their_neighbours():
    vertices, faces = patch()
    count = len(vertices)
    free = vertices[:, 0] > 0.03
    parameters = TissueParameters(np.full(count, 4.0), np.full(count, 0.1), 1.0, 0.7, free)
    body = SoftTissue(vertices, faces, parameters)
    state, drive = displaced(body, 0.0), np.tile([10.0, 0.0, 0.0], (free.sum(), 1))
    for _ in range(30):
        state = body.step(state, drive)
    reach = state.offsets_m[:, 0]
    near, far = vertices[free, 0] < 0.05, vertices[free, 0] > 0.09
    assert reach[near].max() < 0.6 * reach[far].min()


def test_laplacian_is_exact_on_linear_functions_and_not_negative():
    vertices, faces = patch()
    laplacian = cotangent_laplacian(vertices, faces).toarray()
    np.testing.assert_allclose(laplacian, laplacian.T)
    np.testing.assert_allclose(laplacian.sum(1), 0, atol=1e-12)
    x = vertices[:, 0]
    np.testing.assert_allclose(x @ laplacian @ x, 0.1 * 0.1, rtol=1e-9)
    assert np.linalg.eigvalsh(laplacian).min() > -1e-9
    np.testing.assert_allclose(vertex_areas_m2(vertices, faces).sum(), 0.01)
