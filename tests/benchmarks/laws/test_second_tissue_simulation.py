"""The second law on bodies that move: sizes, loads, muscles, and how soft a body is where."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from benchmarks import plugin
from benchmarks.laws.second_tissue_parameters import (
    corpulence_kg_m2,
    layer_parameters,
    prominence_m,
    segment_radii_m,
)
from benchmarks.laws.second_tissue_simulation import (
    SecondTissueSimulator,
    muscle_activation,
    rest_frame_load,
)
from bridge.body.posing import shaped_vertices
from dsnet.synthetic.simulation import TissueSimulator
from dsnet.synthetic.subjects import SUBJECTS
from dsnet.synthetic.tissue_parameters import tissue_parameters

LAWS = {"own": TissueSimulator, **plugin.tissues()}
HEAVY, LEAN = SUBJECTS["female"][0], SUBJECTS["female"][4]


def test_both_laws_find_other_parts_soft(body):
    thick = layer_parameters(body, HEAVY.betas)
    deep = tissue_parameters(body, HEAVY.betas)
    both = thick.free & deep.free
    first, second = (part.frequency_hz[both] for part in (deep, thick))
    assert np.corrcoef(first, second)[0, 1] < 0.8
    assert 3 < thick.frequency_hz.min() < 6


def test_in_free_fall_gravity_is_not_felt(body):
    """What is left of R^T (g - x'') - g is -g: flesh rises against the posture of the scan."""
    times_s = np.arange(30) / 60
    theta = np.zeros((30, 69))
    theta[:, 2] = np.pi / 2
    theta[:, 67] = -9.81 * times_s**2 / 2
    everywhere = np.arange(body.vertex_count)
    load = rest_frame_load(body, np.zeros(10), theta, 60.0, everywhere)
    np.testing.assert_allclose(load[1:], np.broadcast_to([0, 9.81, 0], load[1:].shape), atol=1e-7)


def test_the_frame_rate_hardly_changes_the_motion(body):
    """One second of bouncing at 2 Hz, at its end, against 200 frames per second."""
    exact = bounced(body, 200.0)
    assert np.abs(exact).max() > 5e-3
    for fps in (50.0, 100.0):
        np.testing.assert_allclose(bounced(body, fps), exact, atol=0.08 * np.abs(exact).max())


def bounced(body, fps):
    theta = np.zeros((round(fps) + 1, 69))
    theta[:, 67] = 0.05 * (1 - np.cos(2 * np.pi * 2 * np.arange(len(theta)) / fps))
    return SecondTissueSimulator(body, HEAVY.betas).offsets(theta, fps)[-1]


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("count", [1, 2, 4])
def test_the_shortest_motions_hang_in_their_first_pose(body, law, count):
    theta = np.zeros((count, 69))
    theta[:, 0] = -np.pi / 2
    found = LAWS[law](body, HEAVY.betas, gravity=True).offsets(theta, 60.0)
    assert len(found) == count
    assert 0.003 < np.abs(found[-1]).max() < 0.05


def test_muscles_tense_with_a_delay_and_relax():
    theta = np.zeros((120, 69))
    theta[30:60, 12] = 0.8 * np.sin(np.arange(30))
    knee, other = muscle_activation(theta, 60.0)[:, [4, 5]].T
    assert knee[:29].max() == 0
    assert other.max() == 0
    assert 0.3 < knee[40:60].max() < 1
    # exp(-1 s / 0.07 s) of what it was when the knee came to rest.
    np.testing.assert_allclose(knee[119], knee[61] * np.exp(-58 / 60 / 0.07), rtol=1e-6)


def test_a_bent_joint_stays_tense_and_turning_the_body_needs_no_muscle():
    theta = np.zeros((5, 69))
    theta[:, 0], theta[:, 12] = 2.0, 1.6
    activation = muscle_activation(theta, 60.0)
    np.testing.assert_allclose(activation[:, 4], 1 - np.exp(-1))
    assert activation[:, 0].max() == 0


def test_tense_muscles_hold_flesh(body):
    tissue = SecondTissueSimulator(body, HEAVY.betas)
    theta = np.zeros((3, 69))
    relaxed = tissue._tension(theta, 60.0)
    theta[:, 12] = 2.0
    bent = tissue._tension(theta, 60.0)
    thigh, arm = (body.weights[:, joint] > 0.9 for joint in (1, 16))
    assert relaxed.max() == 1
    assert bent[:, thigh].min() > 1.2
    assert bent[:, arm].max() < 1.01


def test_girth_gives_a_cylinders_radius(body):
    cylinder = trimesh.creation.cylinder(radius=0.07, height=0.4, sections=64)
    for _ in range(3):
        cylinder = cylinder.subdivide()
    sides = np.abs(cylinder.face_normals[:, 2]) < 0.5
    tube = trimesh.Trimesh(cylinder.vertices, cylinder.faces[sides], process=True)

    class Limb:
        faces = tube.faces
        parents = np.array([-1, 0])
        weights = np.tile([1.0, 0.0], (len(tube.vertices), 1))
        J_regressor = np.zeros((2, len(tube.vertices)))

    ends = [tube.vertices[:, 2].argmin(), tube.vertices[:, 2].argmax()]
    Limb.J_regressor[[0, 1], ends] = 1
    radii_m = segment_radii_m(Limb, np.asarray(tube.vertices))  # type: ignore[arg-type]
    np.testing.assert_allclose(radii_m, [0.07, 0.0], rtol=0.1)


def test_corpulence_is_mass_over_squared_height():
    box = trimesh.creation.box((0.3, 1.6, 0.2))
    np.testing.assert_allclose(
        corpulence_kg_m2(np.asarray(box.vertices) + 1, box.faces), 985 * 0.06 / 1.6
    )


def test_breasts_and_thighs_stand_out_and_the_waist_does_not(body):
    vertices = shaped_vertices(body, HEAVY.betas[None])[0]
    standing, weights = prominence_m(vertices, body.faces), body.weights
    chest = weights[:, [6, 9]].sum(1) > 0.8
    breasts = chest & (vertices[:, 2] > np.quantile(vertices[chest, 2], 0.95))
    assert standing[breasts].mean() > 0.015
    assert standing[weights[:, 3] > 0.5].mean() < 0


def test_heads_hands_and_feet_are_held(body):
    free = layer_parameters(body, HEAVY.betas).free
    assert not free[body.weights[:, 15] > 0.9].any()
    assert not free[body.weights[:, [10, 11, 20, 21, 22, 23]].sum(1) > 0.95].any()
    assert free[body.weights[:, [1, 2, 3, 16, 17]].max(1) > 0.9].all()
