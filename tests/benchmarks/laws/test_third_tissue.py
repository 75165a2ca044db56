"""The third tissue law: its columns, what acts sideways, and that the world alone drives it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from benchmarks.laws.third_tissue import RATE_HZ, ThirdTissue, ThirdTissueParameters
from bridge.body.surface_operators import cotangent_laplacian, vertex_areas_m2
from dsnet.synthetic.subjects import SUBJECTS

HEAVY, LEAN = SUBJECTS["female"][0], SUBJECTS["female"][4]


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


def flat_patch() -> ThirdTissueParameters:
    """25 x 25 columns, a centimetre apart."""
    across, along = np.meshgrid(np.arange(25), np.arange(25), indexing="ij")
    flat = 0.01 * np.stack([across, along, 0 * along], -1).reshape(-1, 3)
    corner = (across * 25 + along)[:-1, :-1].reshape(-1, 1)
    faces = np.concatenate([corner + np.array(rest) for rest in ([0, 25, 26], [0, 26, 1])])
    return columns(vertex_areas_m2(flat, faces), cotangent_laplacian(flat, faces))


def test_energy_without_drive_never_grows():
    damping = np.full(25 * 25, 100.0)
    part = replace(flat_patch(), fat_damping_ns_m3=damping, muscle_damping_ns_m3=damping)
    tissue, rng = ThirdTissue(part), np.random.default_rng(0)
    offsets = 0.02 + 0.005 * rng.standard_normal((2, 3, 25 * 25))
    energy = [
        tissue.potential_j(state.offsets_m[0]) + tissue.kinetic_j(state.velocities_m_s[0])
        for state in let_go(tissue, offsets, 100)
    ]
    assert (np.diff(energy) <= 1e-12).all()
    assert energy[-1] < 0.2 * energy[0]
