"""The laws on a body that moves: none explains another, and all hang where they were scanned."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from benchmarks import plugin
from dsnet.synthetic.motions import Skeleton, perform
from dsnet.synthetic.simulation import TissueSimulator
from dsnet.synthetic.subjects import SUBJECTS

LAWS = {"own": TissueSimulator, **plugin.tissues()}
HEAVY = SUBJECTS["female"][0]


def test_the_laws_disagree(body):
    """None explains another, at any scale: they are as measurements of different materials."""
    skeleton = Skeleton(body, HEAVY.betas)
    theta = perform("one_leg_jump", "50004", skeleton, frame_count=50, fps=60.0)
    moved = [law(body, HEAVY.betas, gravity=True).offsets(theta, 60.0) for law in LAWS.values()]
    for first, second in combinations(moved, 2):
        scale = (first * second).sum() / (first**2).sum()
        unexplained = ((second - scale * first) ** 2).sum() / (second**2).sum()
        assert 0.1 < unexplained < 0.9


@pytest.mark.parametrize("law", LAWS)
def test_a_body_at_rest_pose_hangs_as_it_was_scanned(body, law):
    theta = np.tile(np.linspace(0, 0.3, 69) * (np.arange(69) >= 66), (4, 1))
    found = LAWS[law](body, HEAVY.betas, gravity=True).offsets(theta, 60.0)
    np.testing.assert_allclose(found, 0, atol=1e-9)
