"""Pose by pose, the tissue moves as over the whole motion, and as late as it says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body import load_body_model
from bridge.runtime.streaming_tissue import StreamingTissue

BODY = load_body_model("embedded:female")
BETAS = np.linspace(-1, 1, 10)


def motion() -> np.ndarray:
    """Twenty frames of rest, then a swaying, hopping body."""
    times_s = np.clip(np.arange(100) - 20, 0, None) / 60
    theta = np.tile(np.random.default_rng(1).normal(0, 0.2, 69), (100, 1))
    theta[:, 2] += 0.4 * np.sin(5 * times_s) ** 2
    theta[:, 50] += 0.8 * np.sin(8 * times_s) ** 2
    theta[:, 67] += 0.2 * np.sin(9 * times_s) ** 2
    return theta


@pytest.mark.parametrize("look_ahead", [0, 1, 2])
def test_pose_by_pose_is_the_whole_motion(flesh, look_ahead):
    model = replace(flesh, look_ahead=look_ahead)
    theta = motion()
    stream = StreamingTissue(model, BODY, BETAS)
    assert stream.latency_frames == look_ahead
    found = np.stack([stream.step(pose) for pose in theta])
    whole = model.moving_m(BODY, BETAS, theta)
    late = found[look_ahead:]
    np.testing.assert_allclose(late, whole[: len(late)], atol=2e-6)
    assert np.abs(whole).max() > 5e-3


def test_reset_forgets(flesh):
    stream = StreamingTissue(flesh, BODY, BETAS)
    first = [stream.step(pose) for pose in motion()]
    assert np.abs(stream.step(motion()[0]) - first[0]).max() > 1e-4
    stream.reset()
    np.testing.assert_array_equal([stream.step(pose) for pose in motion()], first)


def test_all_vertices_follow_the_nodes(flesh):
    stream = StreamingTissue(flesh, BODY, BETAS)
    at_nodes = stream.step(motion()[0])
    at_vertices = stream.spread(at_nodes)
    np.testing.assert_allclose(at_vertices[flesh.nodes.vertices], at_nodes, atol=1e-6)
    assert at_vertices.shape == (6890, 3)


@pytest.mark.parametrize("shape", [(1, 69), (72,), ()])
def test_other_shapes_are_refused(flesh, shape):
    with pytest.raises(DsnetError, match=r"\(69,\)"):
        StreamingTissue(flesh, BODY, BETAS).step(np.zeros(shape))
