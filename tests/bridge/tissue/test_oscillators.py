"""Oscillators and their loads, against closed forms and bounds of energy."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from bridge.motion import pack_theta
from bridge.paper import FPS
from bridge.tissue.oscillators import GRAVITY_M_S2, STEPS, node_loads
from tests.bridge.tissue.mechanics import (
    ALONE,
    AnySheet,
    GraphSheet,
    ReferenceSheet,
    masses_of,
    mechanics,
)

DT_S = 1 / (STEPS * FPS)


@pytest.fixture(scope="module", params=[GraphSheet, ReferenceSheet])
def make_sheet(request) -> type[AnySheet]:
    return request.param


def rolled(sheet: AnySheet, loads: np.ndarray) -> np.ndarray:
    """Offsets (T, K, 3) of frames under loads (T, K, 3), from rest under the first."""
    now = before = sheet.settled(loads[0])
    found = [now]
    for load in loads[:-1]:
        now, before = sheet.frame(now, before, load)
        found.append(now)
    return np.array(found)


def vibrate(sheet: AnySheet, now: np.ndarray, before: np.ndarray, steps: int):
    """Offsets without load, (steps, K, 3), the given two first."""
    return driven(sheet, now, before, np.broadcast_to(np.zeros_like(now), (steps - 2, *now.shape)))


def driven(sheet: AnySheet, now: np.ndarray, before: np.ndarray, loads: np.ndarray):
    """Offsets under a load for each step, (steps + 2, K, 3), the given two first."""
    found = [before, now]
    for load in loads:
        found.append(sheet.step(found[-1], found[-2], load))
    return np.array(found)


def uneven(count: int) -> dict[str, Any]:
    """Normals that point anywhere, along which springs are half to four times as stiff."""
    rng = np.random.default_rng(9)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return {"normal_ratio": rng.uniform(0.5, 4.0, count), "normals": normals}


def stretched(offsets_m: np.ndarray, springs) -> np.ndarray:
    """P u of (..., K, 3)."""
    along = (offsets_m * springs.normals).sum(-1, keepdims=True)
    return offsets_m + (springs.normal_ratio - 1) * along * springs.normals


@pytest.mark.parametrize("hz", [2.0, 7.0, 20.0])
@pytest.mark.parametrize("damping", [0.0, 0.05, 0.3])
def test_free_vibration_has_the_closed_form_of_average_acceleration(make_sheet, hz, damping):
    """(1 + d + k) x^2 - (2 - 2 k) x + (1 - d + k) = 0 with d = z w dt, k = (w dt)^2 / 4."""
    sheet = make_sheet(mechanics(hz=hz, damping=damping), ALONE)
    drag, spring = damping * 2 * np.pi * hz * DT_S, (np.pi * hz * DT_S) ** 2
    root = np.roots([1 + drag + spring, -(2 - 2 * spring), 1 - drag + spring])[0]
    steps = np.arange(40)
    expected = 0.01 * np.real(root ** steps[:, None, None] * np.ones((1, 1, 3)))
    found = vibrate(sheet, expected[1].astype(np.float32), expected[0].astype(np.float32), 40)
    np.testing.assert_allclose(found, expected, atol=2e-7)
    # Undamped, the phase of a step is 2 atan(w dt / 2), and no amplitude is lost.
    if damping == 0.0:
        assert abs(np.angle(root)) == pytest.approx(2 * np.arctan(np.pi * hz * DT_S))
        assert abs(root) == pytest.approx(1.0)


@pytest.mark.parametrize("stiffening", [0.0, 700.0, 1e4])
def test_a_constant_load_holds_an_offset_of_force_over_stiffness(make_sheet, stiffening):
    omega = 2 * np.pi * 4.0
    sheet = make_sheet(mechanics(hz=4.0, stiffening=stiffening), ALONE)
    load = np.array([[3.0, -9.81, 6.0]], np.float32)
    offset = sheet.settled(load)
    held = omega**2 * (1 + stiffening * (offset**2).sum()) * offset
    np.testing.assert_allclose(held, load, rtol=1e-4)


@pytest.mark.parametrize("ratio", [0.5, 1.0, 3.0])
def test_stiffness_along_the_normal_is_so_many_times_that_along_the_skin(make_sheet, ratio):
    normal, along = np.array([0.6, 0.0, 0.8]), np.array([0.8, 0.0, -0.6])
    springs = mechanics(hz=4.0, damping=0.0, normal_ratio=ratio, normals=normal)
    sheet, spring = make_sheet(springs, ALONE), (2 * np.pi * 4.0) ** 2
    load = (3 * normal + 5 * along)[None].astype(np.float32)
    rest = 3 / (spring * ratio) * normal + 5 / spring * along
    np.testing.assert_allclose(sheet.settled(load)[0], rest, rtol=1e-5, atol=1e-8)
    # And it swings so much faster: the phase of a step is 2 atan(w dt / 2).
    for way, hz in ((normal, 4.0 * np.sqrt(ratio)), (along, 4.0)):
        phase = 2 * np.arctan(np.pi * hz * DT_S)
        expected = 0.01 * np.cos(phase * np.arange(40))[:, None] * way
        start = expected.astype(np.float32)
        found = vibrate(sheet, start[1:2], start[:1], 40)[:, 0]
        np.testing.assert_allclose(found, expected, atol=1e-6)


@pytest.mark.parametrize("wave_speed", [0.5, 4.0])
@pytest.mark.parametrize("hz", [2.0, 15.0])
def test_rest_is_a_fixed_point_of_a_step(make_sheet, nodes, hz, wave_speed):
    springs = mechanics(80, hz=hz, stiffening=700.0, wave_speed=wave_speed, **uneven(80))
    sheet = make_sheet(springs, nodes.laplacian)
    load = np.random.default_rng(0).normal(scale=10, size=(80, 3)).astype(np.float32)
    rest = sheet.settled(load)
    assert np.abs(rest).max() > 1e-3
    np.testing.assert_allclose(sheet.step(rest, rest, load), rest, atol=1e-6)


def test_coupled_rest_solves_the_linear_equation(make_sheet, nodes):
    springs = mechanics(80, hz=5.0, wave_speed=2.0, bending=0.05, **uneven(80))
    load = np.random.default_rng(1).normal(scale=10, size=(80, 3)).astype(np.float32)
    laplacian = nodes.laplacian.toarray().astype(np.float64)
    across = np.einsum("kx,ky->kxy", springs.normals, springs.normals)
    blocks = springs.omega[..., None] ** 2 * (
        np.eye(3) + (springs.normal_ratio[..., None] - 1) * across
    )
    stiffness = np.kron(4.0 * laplacian + 0.05 * laplacian @ laplacian, np.eye(3))
    stiffness += block_diag(*blocks)
    expected = np.linalg.solve(stiffness, load.ravel()).reshape(80, 3)
    found = make_sheet(springs, nodes.laplacian).settled(load)
    assert np.abs(expected).max() > 1e-3
    np.testing.assert_allclose(found, expected, atol=1e-6)


def hanging(count: int, **others: Any):
    """Uneven flesh that hangs by 5 mm to 5 cm, and without weight is up to six times as soft."""
    rng = np.random.default_rng(12)
    hz, sag = rng.uniform(3, 9, count), 10 ** rng.uniform(-2.3, -1.3, count)
    return mechanics(count, hz=hz, stiffening=700.0, sag=sag, **{**uneven(count), **others})


def weightless(springs):
    """The same flesh without sag, s (K, 3), and the load that hangs it by s but for the coupling's:
    from each node's 3 by 3 matrix P."""
    s = springs.sag * np.array([0.0, -1.0, 0.0])
    across = np.einsum("kx,ky->kxy", springs.normals, springs.normals)
    pushed = np.eye(3) + (springs.normal_ratio[..., None] - 1) * across
    stretched_m = (pushed @ s[..., None])[..., 0]
    taut = springs.stiffening * (s * stretched_m).sum(1, keepdims=True)
    omega = springs.omega / np.sqrt(1 + 3 * taut)
    damping = springs.damping_ratio * springs.omega / omega
    flat = replace(springs, omega=omega, damping_ratio=damping, sag=0 * springs.sag)
    return flat, s, omega**2 * (1 + taut) * stretched_m


def test_hanging_flesh_that_nothing_pulls_stays_exactly_where_it_stands(make_sheet, nodes):
    sheet = make_sheet(hanging(80, wave_speed=2.0, bending=0.05), nodes.laplacian)
    none = np.zeros((80, 3), np.float32)
    assert not sheet.settled(none).any()
    now = before = none
    for _ in range(60):
        now, before = sheet.frame(now, before, none)
    assert not now.any() or np.abs(now).max() < 1e-12  # the reference rounds in float64


def test_hanging_flesh_is_flesh_without_sag_under_a_larger_load(make_sheet, nodes):
    springs = hanging(80, wave_speed=2.0, bending=0.05)
    flat, s, load = weightless(springs)
    pulling = nodes.laplacian.toarray().astype(np.float64)
    held = (load + 4.0 * pulling @ s + 0.05 * pulling @ pulling @ s).astype(np.float32)
    hung, free = make_sheet(springs, nodes.laplacian), make_sheet(flat, nodes.laplacian)
    felt = np.random.default_rng(13).normal(scale=30, size=(120, 80, 3)).astype(np.float32)
    start = hung.settled(felt[0])
    np.testing.assert_allclose(free.settled(felt[0] + held), start + s, atol=2e-6)
    found = driven(hung, start, start, felt)
    lifted = (start + s).astype(np.float32)
    expected = driven(free, lifted, lifted, felt + held) - s
    assert np.abs(found).max() > 0.02
    np.testing.assert_allclose(found, expected, atol=2e-5)


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.0, 0.6, 0.8)])
def test_frequency_and_damping_are_those_of_a_small_vertical_vibration_at_rest(make_sheet, normal):
    springs = mechanics(hz=4.0, damping=0.1, stiffening=700.0, sag=0.04, normal_ratio=2.0,
                        normals=normal)  # fmt: skip
    start = 1e-4 * np.array([[0.0, 1.0, 0.0]], np.float32)
    found = vibrate(make_sheet(springs, ALONE), start, start, 120)[:, 0, 1] / 1e-4
    # P makes it stiffer by 1 + (p - 1) n_y^2, as without sag; sideways it mixes in nothing small.
    if normal[1] == 0.0:
        omega, drag = 2 * np.pi * 4.0, 0.1 * 2 * np.pi * 4.0
        swing, times_s = np.sqrt(omega**2 - drag**2), (np.arange(120) - 0.5) * DT_S
        expected = np.cos(swing * times_s) + drag / swing * np.sin(swing * times_s)
        np.testing.assert_allclose(found, np.exp(-drag * times_s) * expected, atol=0.02)
    else:
        assert found.min() < -0.5


def test_in_free_fall_flesh_takes_its_shape_without_weight(make_sheet):
    """That which weight alone has brought down by its sag."""
    sag, stiffening = 0.04, 700.0
    taut = stiffening * sag**2
    omega = np.sqrt(9.81 / sag * (1 + 3 * taut) / (1 + taut))
    sheet = make_sheet(mechanics(hz=omega / 2 / np.pi, stiffening=stiffening, sag=sag), ALONE)
    found = sheet.settled(-GRAVITY_M_S2[None].astype(np.float32))
    np.testing.assert_allclose(found, [[0.0, sag, 0.0]], atol=1e-5)
    # It stiffens downwards and slackens upwards.
    landed = sheet.settled(GRAVITY_M_S2[None].astype(np.float32))
    assert -0.6 * sag < landed[0, 1] < 0


@settings(max_examples=8)
@given(turn=st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_a_body_held_in_any_orientation_comes_to_rest(make_sheet, body, nodes, turn):
    pose = np.zeros((60, 22, 3))
    pose[:, 0] = Rotation.from_rotvec(turn).as_rotvec()
    theta = pack_theta(pose, np.zeros((60, 3)))
    springs = mechanics(80, hz=3.0, stiffening=700.0, wave_speed=1.0)
    load = node_loads(body, nodes.vertices, np.zeros(10), theta, FPS)
    load = load.inertia + load.gravity
    sheet = make_sheet(springs, nodes.laplacian)
    # It was held that way before the first frame, so it is at rest from there on.
    rest = sheet.settled(load[0])
    np.testing.assert_allclose(rolled(sheet, load), np.broadcast_to(rest, load.shape), atol=2e-6)
    # And from anywhere else it gets there.
    now = before = np.zeros_like(rest)
    for _ in range(240):
        now, before = sheet.frame(now, before, load[30])
    np.testing.assert_allclose(now, rest, atol=1e-5)


def energy(found: np.ndarray, springs, laplacian, masses) -> np.ndarray:
    """(T - 1,) between steps, as the module's docstring has it, weighted by the nodes' masses."""
    found = found.astype(np.float64)
    speed, mean = np.diff(found, axis=0) / DT_S, (found[1:] + found[:-1]) / 2
    stretched_m, mean_stretched = (stretched(u, springs) for u in (found, mean))
    squared = (found * stretched_m).sum(-1)
    spring = springs.omega[:, 0].astype(np.float64) ** 2
    quartic = spring * springs.stiffening[:, 0] * squared[1:] * squared[:-1] / 4
    pulling = laplacian.toarray().astype(np.float64)
    coupling = springs.wave_speed**2 * pulling + springs.bending * pulling @ pulling
    pulled = np.einsum("kl,tlx->tkx", coupling, mean)
    own = (speed**2 + spring[:, None] * mean * mean_stretched + mean * pulled).sum(-1) / 2
    own += quartic
    return (own * masses).sum(1)


@pytest.mark.parametrize("stiffening", [0.0, 700.0, 1e4])
def test_without_damping_a_lone_node_keeps_its_energy(make_sheet, stiffening):
    springs = mechanics(hz=9.0, damping=0.0, stiffening=stiffening, **uneven(1))
    start = np.array([[0.05, 0.03, -0.08]], np.float32)
    found = vibrate(make_sheet(springs, ALONE), start, np.zeros_like(start), 6000)
    kept = energy(found, springs, ALONE, np.ones(1))
    np.testing.assert_allclose(kept, kept[0], rtol=1e-3)


@pytest.mark.parametrize("bending", [0.0, 1.0])
def test_a_sheet_without_load_never_gains_energy(nodes, bending):
    """For uneven springs too; what Jacobi's sweeps leave may neither build up nor feed it."""
    rng = np.random.default_rng(3)
    hz, stiffening = rng.uniform(2, 40, 80), rng.uniform(0, 1e4, 80)
    springs = mechanics(80, hz=hz, damping=0.01, stiffening=stiffening, wave_speed=4.0,
                        bending=bending, **uneven(80))  # fmt: skip
    start = rng.normal(scale=0.05, size=(80, 3)).astype(np.float32)
    found = vibrate(GraphSheet(springs, nodes.laplacian), start, start * 0, 6000)
    left = energy(found, springs, nodes.laplacian, masses_of(nodes.laplacian))
    assert left.max() < 1.1 * left[0]
    assert left[2000:].max() < 0.1 * left[0]
    assert left[-1] < 0.02 * left[0]


def test_undamped_linear_sheet_keeps_its_energy_over_long_times(nodes):
    springs = mechanics(80, hz=6.0, damping=0.0, wave_speed=1.0, bending=1e-3, **uneven(80))
    start = np.random.default_rng(4).normal(scale=0.01, size=(80, 3)).astype(np.float32)
    found = vibrate(GraphSheet(springs, nodes.laplacian), start, start, 12_000)
    kept = energy(found, springs, nodes.laplacian, masses_of(nodes.laplacian))
    np.testing.assert_allclose(kept, kept[0], rtol=0.05)
    assert kept[-1000:].mean() == pytest.approx(kept[:1000].mean(), rel=0.02)


@pytest.mark.parametrize("force_m_s2", [30.0, 500.0])
def test_violent_load_for_minutes_gives_no_more_than_physics_allows(nodes, force_m_s2):
    """10,000 frames of white noise, the softest to the stiffest springs, hardly damped.

    A kick f dt brings f^2 dt^2 / 2 of kinetic energy on average, whatever the springs; drag takes
    2 z w v^2 dt of it away. So over time the sum of m 2 z w <v^2> is no more than that of
    m <f^2> dt / 2.
    And at no time is the root of twice the energy more than the sum of the kicks.
    """
    rng = np.random.default_rng(5)
    hz = np.geomspace(2, 40, 80)[rng.permutation(80)]
    stiffening = np.where(rng.random(80) < 0.2, 0.0, 10 ** rng.uniform(1, 4, 80))
    springs = mechanics(80, hz=hz, damping=0.01, stiffening=stiffening, wave_speed=4.0,
                        bending=0.05, **uneven(80))  # fmt: skip
    load = rng.normal(scale=force_m_s2, size=(20_000, 80, 3)).astype(np.float32)
    start = np.zeros((80, 3), np.float32)
    found = driven(GraphSheet(springs, nodes.laplacian), start, start, load)
    assert np.isfinite(found).all()
    masses = masses_of(nodes.laplacian)
    stored = energy(found, springs, nodes.laplacian, masses)
    kicks = DT_S * np.sqrt((masses[:, None] * load.astype(np.float64) ** 2).sum((1, 2)))
    assert (np.sqrt(2 * stored) <= 1.01 * np.append(0, np.cumsum(kicks)) + 1e-6).all()
    velocity = (found[2:] - found[:-2]) / (2 * DT_S)
    rate = 2 * springs.damping_ratio[:, 0] * springs.omega[:, 0]
    taken = (masses * rate * (velocity**2).sum(-1).mean(0)).sum()
    given_away = (masses * 3 * force_m_s2**2 * DT_S / 2).sum()
    assert 0.1 * given_away < taken < 1.1 * given_away
    # It does not build up either.
    assert stored[-6000:].mean() < 1.5 * stored[4000:10_000].mean()


@pytest.mark.parametrize("hz", [7.0, 15.0])
def test_a_burst_rings_out_however_far_it_drove_the_nodes(make_sheet, nodes, hz):
    """With any coupling, of which no energy is known that it keeps: seen and not proved."""
    rng = np.random.default_rng(10)
    coupling = {"wave_speed": rng.uniform(0.5, 6.0, 80), "bending": 10 ** rng.uniform(-3, 0, 80)}
    springs = mechanics(80, hz=hz, stiffening=1e4, **coupling, **uneven(80))
    load = np.zeros((400, 80, 3), np.float32)
    load[1:20] = np.random.default_rng(6).normal(scale=400, size=(19, 80, 3))
    found = rolled(make_sheet(springs, nodes.laplacian), load)
    assert np.abs(found[:40]).max() > 0.1
    assert np.abs(found[-100:]).max() < 1e-6


@pytest.mark.parametrize("wave_speed", [1.0, 4.0])
def test_sweeps_come_near_the_exact_step(make_sheet, nodes, wave_speed):
    springs = mechanics(80, hz=7.0, wave_speed=wave_speed)
    sheet = make_sheet(springs, nodes.laplacian)
    rng = np.random.default_rng(7)
    load = rng.normal(scale=20, size=(240, 80, 3)).astype(np.float32)
    load = uniform_filter1d(load, 9, axis=0, mode="nearest")
    rest = sheet.settled(load[0])
    found = driven(sheet, rest, rest, load).astype(np.float64)
    omega, damping = springs.omega.astype(np.float64), 0.15
    stiff = np.diag(omega[:, 0] ** 2) + wave_speed**2 * nodes.laplacian.toarray()
    drag = DT_S * damping * omega
    system = np.eye(80) + np.diag(drag[:, 0]) + DT_S**2 / 4 * stiff
    exact = [rest.astype(np.float64)] * 2
    for felt in load:
        before, now = exact[-2:]
        known = DT_S**2 * felt + 2 * now - before + drag * before
        known -= DT_S**2 / 4 * stiff @ (2 * now + before)
        exact.append(np.linalg.solve(system, known))
    missed = np.square(found - exact).sum() / np.square(exact).sum()
    assert missed < 1e-3


def test_a_frame_is_two_steps_under_one_load(make_sheet):
    sheet = make_sheet(mechanics(hz=7.0, stiffening=700.0), ALONE)
    load, rest = np.array([[3.0, 0.0, -8.0]], np.float32), np.zeros((1, 3), np.float32)
    steps = driven(sheet, rest, rest, np.stack([load] * STEPS))
    now, before = sheet.frame(rest, rest, load)
    np.testing.assert_array_equal(steps[-2:], [before, now])
