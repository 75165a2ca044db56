"""Features of motions: a known motion has known rates."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.systems.kinematics import KINEMATICS_SIZE, kinematics
from bridge.motion import pack_theta
from tests.forged.lively import lively

FPS = 60.0
FRAMES = len(lively())


def turning(joint: int, rad_s: NDArray, start: Rotation) -> NDArray:
    """A body that stands, but for one joint at a constant rate in its own frame."""
    pose = np.zeros((FRAMES, 22, 3))
    steps = Rotation.from_rotvec(np.arange(FRAMES)[:, None] / FPS * rad_s)
    pose[:, joint] = (start * steps).as_rotvec()
    return pack_theta(pose, np.zeros((FRAMES, 3)))


@pytest.mark.parametrize(("joint", "column"), [(0, 6), (1, 12), (5, 24), (21, 72)])
def test_a_constant_turn_has_a_constant_rate_in_every_frame(joint, column):
    rad_s = np.array([3.0, -5.0, 8.0])  # more than a whole turn, through pi
    found = kinematics(turning(joint, rad_s, Rotation.from_rotvec([0.3, 2.0, -0.4])))
    assert found.shape == (FRAMES, KINEMATICS_SIZE) == (FRAMES, 138)
    np.testing.assert_allclose(found[1:, column : column + 3], np.tile(rad_s, (FRAMES - 1, 1)))
    found[:, column : column + 3] = 0.0
    np.testing.assert_allclose(found, 0.0, atol=1e-8)
