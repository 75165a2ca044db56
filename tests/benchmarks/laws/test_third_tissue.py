"""The third tissue law: its columns, what acts sideways, and that the world alone drives it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, cg
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from benchmarks.laws.third_tissue import RATE_HZ, ThirdTissue, ThirdTissueParameters
from benchmarks.laws.third_tissue_parameters import fat_depths_m, lean_betas
from benchmarks.laws.third_tissue_simulation import ThirdTissueSimulator, nearest_rotations
from bridge.body.posing import shaped_joints
from bridge.body.surface_operators import cotangent_laplacian, vertex_areas_m2
from dsnet.synthetic.motions import Skeleton, perform
from dsnet.synthetic.subjects import SUBJECTS

HEAVY, LEAN = SUBJECTS["female"][0], SUBJECTS["female"][4]


@pytest.fixture(scope="module")
def heavy(body):
    return ThirdTissueSimulator(body, HEAVY.betas)


def columns(areas_m2, laplacian) -> ThirdTissueParameters:
    """Equal undamped columns of 3 cm of fat, their normals along x."""
    one = np.ones(len(areas_m2))
    return ThirdTissueParameters(
        axes=np.eye(3)[:, :, None] * one,
        areas_m2=areas_m2,
        laplacian=laplacian,
        skin_kg_m2=16 * one,
        muscle_kg_m2=30 * one,
        fat_depth_m=0.03 * one,
        fat_along_n_m3=8e3 * one,
        fat_pulled_n_m3=16e3 * one,
        fat_pressed_n_m3=32e3 * one,
        fat_reach_m=0.024 * one,
        fat_damping_ns_m3=0 * one,
        muscle_n_m3=30e3 * np.ones((3, 1)) * one,
        muscle_damping_ns_m3=0 * one,
        volume_n_m3=64e3 * one,
        shear_n_m3=0.0,
        neighbourhood_m=0.03,
        quadratic_speed_m_s=1.0,
    )


def one_column() -> ThirdTissueParameters:
    return replace(columns(np.ones(1), sp.csr_matrix((1, 1))), volume_n_m3=np.zeros(1))


def let_go(tissue, offsets, steps):
    """States from offsets (2, 3, N) at rest, on anchors that are still."""
    skin_m, axes = np.zeros(offsets.shape[1:]), tissue.parameters.axes
    state = tissue.settled(skin_m, axes)
    places = state.places_m[0] + (axes * offsets[:, None]).sum(2)
    states = [state._replace(offsets_m=(offsets, offsets), places_m=(places, places))]
    for _ in range(steps):
        states.append(tissue.step(states[-1], skin_m, axes))
    return states


@pytest.mark.parametrize("mode", [0, 1])
def test_a_column_swings_in_two_modes_of_the_analytic_frequencies(mode):
    part = one_column()
    fat, muscle = part.fat_along_n_m3[0], part.muscle_n_m3[1, 0]
    masses = np.array([part.muscle_kg_m2[0], part.skin_kg_m2[0]])
    stiffness = np.array([[muscle + fat, -fat], [-fat, fat]]) / np.sqrt(np.outer(masses, masses))
    squares, shapes = np.linalg.eigh(stiffness)
    offsets = np.zeros((2, 3, 1))
    offsets[:, 1, 0] = 1e-4 * shapes[:, mode] / np.sqrt(masses)
    moved = np.array([s.offsets_m[0][1, 1, 0] for s in let_go(ThirdTissue(part), offsets, 240)])
    after = np.flatnonzero(moved[1:] * moved[:-1] < 0)
    crossings = after + moved[after] / (moved[after] - moved[after + 1])
    frequency_hz = RATE_HZ / 2 / np.diff(crossings).mean()
    np.testing.assert_allclose(frequency_hz, np.sqrt(squares[mode]) / 2 / np.pi, rtol=0.02)


def test_energy_without_drive_never_grows(heavy):
    tissue = heavy.tissue
    count = len(heavy.free)
    rng = np.random.default_rng(0)
    offsets = 0.02 * np.ones((2, 3, count)) + 0.005 * rng.standard_normal((2, 3, count))
    states = let_go(tissue, offsets, 100)
    energy = np.array(
        [tissue.potential_j(s.offsets_m[0]) + tissue.kinetic_j(s.velocities_m_s[0]) for s in states]
    )
    assert (np.diff(energy) <= 1e-12).all()
    assert energy[-1] < 0.2 * energy[0]


def test_sideways_forces_have_an_energy_that_is_least_at_rest(heavy):
    tissue, count = heavy.tissue, len(heavy.free)
    one, other = np.random.default_rng(1).standard_normal((2, 3, count))
    areas = tissue.parameters.areas_m2
    there, back = (areas * tissue.sideways(one) * other), (areas * tissue.sideways(other) * one)
    np.testing.assert_allclose(there.sum(), back.sum(), rtol=1e-9)
    assert (areas * tissue.sideways(one) * one).sum() < 0
    np.testing.assert_array_equal(tissue.sideways(0 * one), 0)


def test_a_press_bulges_out_around_and_keeps_its_share_of_volume():
    across, along = np.meshgrid(np.arange(25), np.arange(25), indexing="ij")
    flat = 0.01 * np.stack([across, along, 0 * along], -1).reshape(-1, 3)
    corner = (across * 25 + along)[:-1, :-1].reshape(-1, 1)
    faces = np.concatenate([corner + np.array(rest) for rest in ([0, 25, 26], [0, 26, 1])])
    part = columns(vertex_areas_m2(flat, faces), cotangent_laplacian(flat, faces))
    tissue, spring = ThirdTissue(part), part.fat_along_n_m3[0]

    def held_back(normal):
        skin = np.stack([normal, 0 * normal, 0 * normal])
        return part.areas_m2 * (spring * normal - tissue.sideways(skin)[0])

    press = np.zeros(len(flat))
    press[12 * 25 + 12] = -10.0
    operator = LinearOperator((len(flat),) * 2, matvec=held_back, dtype=float)  # type: ignore
    found, failed = cg(operator, press, rtol=1e-12)
    assert not failed
    assert found.max() > 0 > found[12 * 25 + 12]
    out, pressed = (part.areas_m2 @ np.clip(found, *ends) for ends in ((0, None), (None, 0)))
    assert out > -0.6 * pressed
    kept = 1 - spring * (part.areas_m2 @ found) / press.sum()
    np.testing.assert_allclose(kept, part.volume_n_m3[0] / (part.volume_n_m3[0] + spring))


def test_turning_with_constant_speed_pulls_outwards():
    part = replace(one_column(), fat_damping_ns_m3=np.full(1, 300.0))
    part = replace(part, muscle_damping_ns_m3=np.full(1, 300.0))
    tissue, speed_rad_s, radius_m = ThirdTissue(part, gravity=False), 4.0, 0.5
    state = tissue.settled(np.array([[radius_m], [0.0], [0.0]]), part.axes)
    for step in range(1, 720):
        turn = Rotation.from_rotvec([0, speed_rad_s * step / RATE_HZ, 0]).as_matrix()
        state = tissue.step(state, radius_m * turn[:, :1], turn[:, :, None])
    pull = speed_rad_s**2 * np.array([radius_m - 0.03, radius_m]) * [30, 16]
    muscle = pull.sum() / part.muscle_n_m3[0, 0]
    expected = [muscle, muscle + pull[1] / part.fat_pulled_n_m3[0]]
    found = state.offsets_m[0][:, :, 0]
    np.testing.assert_allclose(found[:, 0], expected, rtol=0.1)
    np.testing.assert_allclose(found[:, 1:], 0, atol=1e-4)


def test_pressed_fat_gives_less_than_pulled_and_stiffens_without_limit():
    tissue, stretch = ThirdTissue(one_column()), np.zeros((2, 3, 1))

    def energy(skin_m):
        stretch[1, 0] = skin_m
        return tissue.potential_j(stretch)

    np.testing.assert_allclose(energy(-1e-5) / energy(1e-5), 2, rtol=1e-3)
    slopes = [(energy(x + 1e-6) - energy(x - 1e-6)) / 2e-6 / x for x in (1e-3, 0.03, 0.1, 1.0)]
    assert (np.diff(slopes) > 0).all()
    assert slopes[3] > 20 * slopes[2]


def test_heading_and_place_do_not_matter(body, heavy):
    skeleton = Skeleton(body, HEAVY.betas)
    theta = perform("one_leg_jump", "50004", skeleton, frame_count=14, fps=60.0)
    pelvis, turn = (
        shaped_joints(body, HEAVY.betas[None])[0, 0],
        Rotation.from_rotvec([0, 2, 0]),
    )
    moved = theta.copy()
    moved[:, :3] = (turn * Rotation.from_rotvec(theta[:, :3])).as_rotvec()
    moved[:, 66:] = turn.apply(pelvis + theta[:, 66:]) - pelvis + [3.0, 0.2, -2.0]
    found = heavy.offsets(moved, 60.0)
    assert np.abs(found).max() > 1e-3
    np.testing.assert_allclose(found, heavy.offsets(theta, 60.0), atol=1e-6)


def swing(fps: float, frames: int) -> np.ndarray:
    """Half a second and more of hopping, twisting and bending, the same at any rate."""
    time_s = np.arange(frames) / fps
    theta, begun = np.zeros((frames, 69)), 1 - np.cos(2 * np.pi * 1.5 * time_s)
    theta[:, 67] = 0.05 * begun * np.sin(2 * np.pi * 3 * time_s)
    theta[:, [1, 3, 9]] = 0.2 * begun[:, None]
    return theta


def test_sixty_frames_a_second_give_what_a_hundred_and_twenty_give(heavy):
    slow, fast = heavy.offsets(swing(60, 36), 60.0), heavy.offsets(swing(120, 71), 120.0)
    assert np.abs(slow).max() > 0.01
    np.testing.assert_allclose(slow, fast[::2], atol=0.03 * np.abs(slow).max())


def test_violent_shaking_stays_bounded(heavy):
    """5 g at 5 Hz, and ten times that."""
    theta = np.zeros((36, 69))
    theta[:, 67] = 5 * 9.81 / (10 * np.pi) ** 2 * np.sin(10 * np.pi * np.arange(36) / 60)
    assert 0.02 < np.abs(heavy.offsets(theta, 60.0)).max() < 0.1
    assert np.abs(heavy.offsets(10 * theta, 60.0)).max() < 0.5


def test_fat_is_equal_left_and_right_and_none_is_added_to_the_lean(body):
    data = body
    fat = fat_depths_m(data, HEAVY.betas)
    gap, mirrored = KDTree(data.v_template).query(data.v_template * [-1, 1, 1])
    close = gap < 0.002
    assert close.sum() > 3000
    np.testing.assert_allclose(fat[mirrored][close], fat[close], atol=0.003)
    lean = lean_betas(data, HEAVY.betas)
    np.testing.assert_allclose(lean_betas(data, lean), lean, atol=1e-9)
    assert fat_depths_m(data, lean).max() < 0.0125 < 0.05 < fat.max()


def test_nearest_rotations_are_those_of_a_singular_value_decomposition():
    rotations = Rotation.random(50, random_state=2).as_matrix()
    matrices = 0.6 * rotations + 0.4 * Rotation.from_rotvec([0.9, 0.5, 0.3]).as_matrix()
    matrices = matrices[np.linalg.det(matrices) > 0.05]
    left, _, right = np.linalg.svd(matrices)
    found = nearest_rotations(matrices.transpose(1, 2, 0)).transpose(2, 0, 1)
    np.testing.assert_allclose(found, left @ right, atol=1e-9)


def test_a_rate_that_does_not_divide_the_steps_is_refused(heavy):
    with pytest.raises(ValueError, match="not a multiple"):
        heavy.offsets(np.zeros((2, 69)), 50.0)
