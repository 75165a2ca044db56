"""The flesh of a real person who jumps and then stands: it moves with the jumps, and dies away.

At the rate that the file says, and at half of it, which is what free fall says.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from bridge.body import load_body_model
from bridge.body.posing import joint_rotations, joint_transforms, shaped_joints
from bridge.motion import Motion, load_motion, unpack_theta
from dsnet.prediction.load_model import TrainedModel
from dsnet.prediction.moving_body import MovingBody, place_motion
from dsnet.prediction.shape_space import with_betas_on
from dsnet.verify.reference.oscillators import node_offsets

SAMPLE = Path(os.environ.get("DSNET_TEST_DATA", "nowhere")) / "amass" / "dmpl_sample.npz"
pytestmark = [
    pytest.mark.licensed,
    pytest.mark.skipif(not SAMPLE.exists(), reason="no $DSNET_TEST_DATA/amass/dmpl_sample.npz"),
]
BODY = load_body_model("embedded:female")
END = slice(-18, None)
"""The last 0.3 s."""


@pytest.fixture(scope="module", params=[False, True], ids=["file", "markers"])
def by_markers(request) -> bool:
    """Whose shape: her file's, or as her markers have it, as without an option."""
    return request.param


@pytest.fixture(scope="module", params=[120.0, 60.0])
def jumped(request, soft: TrainedModel, by_markers) -> tuple[Motion, np.ndarray]:
    """How she moves, and (T,) the mean offset of each frame in millimetres."""
    read = load_motion(SAMPLE, request.param)
    placed = place_motion(with_betas_on(read, BODY) if by_markers else read, BODY)
    moving = MovingBody(soft, placed)
    assert len(moving.pieces) == 1
    offsets_m = np.concatenate([posed.offsets_m for posed in moving])
    return placed, 1e3 * np.linalg.norm(offsets_m, axis=-1).mean(axis=1)


def pelvis_acceleration_g(motion: Motion) -> np.ndarray:
    """(T,) upwards, in units of g."""
    pose, trans = unpack_theta(motion.theta)
    joints = shaped_joints(BODY, motion.betas[None])
    bones = joint_transforms(
        joint_rotations(BODY, pose), joints.repeat(len(pose), 0), BODY.parents, trans
    )
    height_m = bones[:, 0, 1, :3] @ joints[0, 0] + bones[:, 0, 1, 3]
    return np.gradient(np.gradient(height_m)) * motion.fps**2 / 9.81


def test_it_peaks_at_a_landing(jumped, by_markers):
    motion, mean_mm = jumped
    landings = np.flatnonzero(pelvis_acceleration_g(motion) > 4 * (motion.source_fps / 120) ** 2)
    assert len(landings) > 3
    after = mean_mm.argmax() - landings
    # 0.17 s: half a vibration of 3 Hz, as flesh swings that hangs; 0.2 s: of 2.5, a larger bust.
    assert after[after >= 0].min() <= (12 if by_markers else 10)


def test_it_dies_away_as_she_stands(jumped):
    _, mean_mm = jumped
    assert mean_mm[END].mean() < mean_mm.max() / 5


def test_what_is_left_is_the_sag_of_where_the_arms_hang(jumped, flesh):
    """The template's arms are raised: hanging, they feel gravity and do not return to zero."""
    motion, mean_mm = jumped
    last = motion.theta[-1:]
    sag_m = node_offsets(flesh, BODY, last, motion.betas)
    sag_mm = 1e3 * np.linalg.norm(flesh.nodes.spread(sag_m)[0], axis=-1)
    arms = BODY.weights[:, 16:22].sum(axis=1) > 0.5
    assert sag_mm[arms].mean() > 3 * sag_mm[~arms].mean()
    assert sag_mm.mean() < mean_mm[-1] < 2 * sag_mm.mean()
