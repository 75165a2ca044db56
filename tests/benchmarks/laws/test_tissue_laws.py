"""What all tissue laws owe to a body that moves: sizes, smoothness, and hanging where it lies."""

from __future__ import annotations

from functools import cache
from itertools import combinations
from typing import NamedTuple

import numpy as np
import pytest

from benchmarks import plugin
from bridge.tissue.nodes import TissueNodes
from dsnet.synthetic.motions import Skeleton, perform
from dsnet.synthetic.simulation import TissueSimulator
from dsnet.synthetic.subjects import SUBJECTS

LAWS = {"own": TissueSimulator, **plugin.tissues()}
HEAVY, LEAN = SUBJECTS["female"][0], SUBJECTS["female"][4]


class Moved(NamedTuple):
    """Offsets (T, V, 3) of one_leg_jump by the same poses."""

    law: str
    heavy: np.ndarray
    lean: np.ndarray


@pytest.fixture(scope="module")
def moved_by(body):
    """Of a law by its name; each is simulated once."""
    skeleton = Skeleton(body, HEAVY.betas)
    theta = perform("one_leg_jump", "50004", skeleton, frame_count=70, fps=60.0)

    @cache
    def moved(law: str) -> Moved:
        people = (LAWS[law](body, p.betas, gravity=True) for p in (HEAVY, LEAN))
        return Moved(law, *(person.offsets(theta, 60.0) for person in people))

    return moved


@pytest.fixture(params=LAWS)
def moved(moved_by, request):
    return moved_by(request.param)


def test_the_laws_disagree(moved_by):
    """None explains another, at any scale: they are as measurements of different materials."""
    found = [moved_by(law).heavy for law in LAWS]
    for first, second in combinations(found, 2):
        scale = (first * second).sum() / (first**2).sum()
        unexplained = ((second - scale * first) ** 2).sum() / (second**2).sum()
        assert 0.1 < unexplained < 0.9


def test_sizes_are_plausible_and_heavier_bodies_move_more(moved):
    heavy, lean = (np.linalg.norm(part, axis=-1) * 1000 for part in (moved.heavy, moved.lean))
    assert heavy[40:].mean() > 1.3 * lean[40:].mean()
    assert 1.0 < heavy[40:].mean() < 8.0
    assert 15 < heavy.max() < (120 if moved.law == "own" else 60)


def test_offsets_are_smooth_over_the_surface(body, moved):
    bounds = {"own": (0.7, 0.04), "second": (1.2, 0.03), "third": (0.6, 0.03)}
    strain_bound, step_bound_m = bounds[moved.law]
    faces, peak = body.faces, moved.heavy[np.abs(moved.heavy).max((1, 2)).argmax()]
    edges = body.v_template[faces[:, 0]] - body.v_template[faces[:, 1]]
    steps = peak[faces[:, 0]] - peak[faces[:, 1]]
    strain = np.linalg.norm(steps, axis=1) / np.linalg.norm(edges, axis=1)
    assert np.quantile(strain, 0.99) < strain_bound
    assert np.linalg.norm(steps, axis=1).max() < step_bound_m


def test_five_hundred_nodes_keep_all_but_a_hundredth(body, moved):
    nodes = TissueNodes.of(body, 500)
    missed = moved.heavy - nodes.spread(nodes.gather(moved.heavy))
    assert np.square(missed).sum() < 0.01 * np.square(moved.heavy).sum()


@pytest.mark.parametrize("law", LAWS)
def test_a_body_at_rest_pose_hangs_as_it_was_scanned(body, law):
    theta = np.tile(np.linspace(0, 0.3, 69) * (np.arange(69) >= 66), (4, 1))
    found = LAWS[law](body, HEAVY.betas, gravity=True).offsets(theta, 60.0)
    np.testing.assert_allclose(found, 0, atol=1e-9)


@pytest.mark.parametrize("gravity", [True, False])
@pytest.mark.parametrize("law", LAWS)
def test_a_body_that_lies_still_hangs_and_stays(body, law, gravity):
    """On her back: gravity in her own frame turns from down to back, and flesh follows it."""
    theta = np.zeros((20, 69))
    theta[:, 0] = -np.pi / 2
    found = LAWS[law](body, HEAVY.betas, gravity=gravity).offsets(theta, 60.0)
    belly = np.linalg.norm(found[0], axis=-1).argmax()
    if gravity:
        # R^T g - g = (0, +g, -g): towards the head and towards the back.
        assert 0.003 < np.linalg.norm(found[0, belly]) < 0.07
        assert found[0, belly, 1] > 0 > found[0, belly, 2]
    np.testing.assert_allclose(found, found[:1].repeat(20, axis=0), atol=1e-6)
    assert gravity == bool(np.abs(found).max() > 1e-6)
