"""The whole of `dsnet_plus` in a graph is the whole-clip prediction, posed by the oracle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import onnx
import onnxruntime
import pytest

from bridge.body import load_body_model, pose_vertices
from bridge.motion import unpack_theta
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.onnx.body_graph import bone_weights
from dsnet.onnx.onnx_graph import GraphSession
from dsnet.onnx.plus_graph import plus_graph, plus_layout
from dsnet.prediction.models import PlusModel, predict_whole

BODY = load_body_model("embedded:female")
FRAMES = 24
BETAS = np.stack([np.zeros(10), np.linspace(-1, 1, 10)]).astype(np.float32)


def motion(seed: int, still: int = 4) -> np.ndarray:
    """A swaying, hopping body, some metres off; it stands still for some frames."""
    times_s = np.maximum(np.arange(FRAMES) - still, 0) / 60
    theta = np.tile(np.random.default_rng(seed).normal(0, 0.2, 69), (FRAMES, 1))
    theta[:, 2] += 0.4 * np.sin(5 * times_s)
    theta[:, 50] += 0.8 * np.sin((8 + seed) * times_s)
    theta[:, 66] += 3.0 * seed
    theta[:, 67] += 0.2 * np.sin(9 * times_s)
    return theta.astype(np.float32)


class Stepped:
    """A graph and its state."""

    def __init__(self, model: onnx.ModelProto) -> None:
        self.session = onnxruntime.InferenceSession(
            model.SerializeToString(), providers=["CPUExecutionProvider"]
        )
        self.state = self.none(0)

    def none(self, characters: int) -> np.ndarray:
        return np.zeros((characters, self.session.get_inputs()[2].shape[1]), np.float32)

    def __call__(self, theta: np.ndarray, betas: np.ndarray) -> np.ndarray:
        feed = {"theta": theta, "betas": betas, "state": self.state}
        vertices, self.state = map(np.asarray, self.session.run(None, feed))
        return vertices

    def clip(self, theta: np.ndarray, betas: np.ndarray) -> np.ndarray:
        """(T, B, V, 3) from theta (T, B, 69), of characters that begin."""
        self.state = self.none(len(betas))
        return np.stack([self(frame, betas) for frame in theta])


def whole_clip(model: TrainedPlus, theta: np.ndarray, betas: np.ndarray) -> np.ndarray:
    theta, betas = theta.astype(np.float64), betas.astype(np.float64)
    offsets_m = np.concatenate(list(predict_whole(PlusModel(model, BODY), theta, betas).offsets_m))
    shapes = np.tile(betas, (len(theta), 1))
    return pose_vertices(BODY, shapes, *unpack_theta(theta), offsets_m)


@pytest.fixture(scope="module")
def stepped(flesh) -> Stepped:
    return Stepped(plus_graph(flesh, BODY))


def two(still: int = 4) -> np.ndarray:
    return np.stack([motion(0, still), motion(1, still)], axis=1)


def with_static(model: TrainedPlus) -> TrainedPlus:
    rng, static = np.random.default_rng(4), model.static
    constant = rng.normal(0, 2e-3, static.constant_m.shape).astype(np.float32)
    by_pose = rng.normal(0, 1e-3, static.by_pose_m.shape).astype(np.float32)
    return replace(model, static=replace(static, constant_m=constant, by_pose_m=by_pose))


# Who moves from the first frame on is as if she had stood there: no jolt in either.
@pytest.mark.parametrize("still", [0, 4])
@pytest.mark.parametrize("look_ahead", [0, 1, 2])
def test_frame_by_frame_is_the_whole_clip(flesh, look_ahead, still):
    model = replace(flesh, look_ahead=look_ahead)
    theta = two(still)
    found = Stepped(plus_graph(model, BODY)).clip(theta, BETAS)
    for character, betas in enumerate(BETAS):
        expected = whole_clip(model, theta[:, character], betas)
        late = found[look_ahead:, character]
        np.testing.assert_allclose(late, expected[: len(late)], atol=1e-5)
    rest = pose_vertices(BODY, np.tile(BETAS[1], (FRAMES, 1)), *unpack_theta(theta[:, 1]))
    assert np.abs(expected - rest).max() > 3e-3


@pytest.mark.parametrize("look_ahead", [1, 2])
@pytest.mark.parametrize("frames", [1, 2, FRAMES])
def test_a_motion_that_ends_is_the_whole_clip_to_its_last_frame(flesh, look_ahead, frames):
    """Without moves, the last pose again: it stands still without a jolt."""
    model, theta = replace(flesh, look_ahead=look_ahead), motion(1)[:frames, None]
    stepped, moves = Stepped(plus_graph(model, BODY)), plus_layout(model).columns("moves")
    found = [*stepped.clip(theta, BETAS[1:])]
    stepped.state = stepped.state.copy()
    stepped.state[:, moves] = 0
    found += [stepped(theta[-1], BETAS[1:]) for _ in range(look_ahead)]
    expected = whole_clip(model, theta[:, 0], BETAS[1])
    np.testing.assert_allclose(np.stack(found)[look_ahead:, 0], expected, atol=1e-5)


def test_one_tap_needs_no_past_loads(flesh):
    weights = replace(flesh.weights, taps=np.ones(1, np.float32))
    model = replace(flesh, weights=weights, look_ahead=0)
    assert "felt" not in plus_layout(model).shapes
    found = Stepped(plus_graph(model, BODY)).clip(motion(1)[:, None], BETAS[1:])
    np.testing.assert_allclose(found[:, 0], whole_clip(model, motion(1), BETAS[1]), atol=1e-5)


def test_what_is_static_is_added_to_whom_it_belongs(flesh):
    model = with_static(flesh)
    theta = two()[:6]
    found = Stepped(plus_graph(model, BODY)).clip(theta, BETAS)
    for character, betas in enumerate(BETAS):
        expected = whole_clip(model, theta[:, character], betas)
        np.testing.assert_allclose(found[1:, character], expected[:-1], atol=1e-5)


def test_who_begins_is_settled(stepped):
    held = np.repeat(motion(1)[:1, None], 30, axis=0)
    found = stepped.clip(held, BETAS[1:])
    assert np.abs(found - found[0]).max() < 2e-6
    hanging = pose_vertices(BODY, BETAS[1:], *unpack_theta(held[0]))
    assert np.abs(found[0] - hanging).max() > 1e-3


def test_characters_come_and_go_without_disturbing_others(stepped):
    theta = two()
    alone = stepped.clip(theta[:, :1], BETAS[:1])[:, 0]
    stepped.state, found = stepped.none(1), []
    for frame in range(FRAMES):
        if frame == 8:  # another one joins, in front of her
            stepped.state = np.concatenate([stepped.none(1), stepped.state])
        if frame == 18:
            stepped.state = stepped.state[1:]
        characters = [1, 0] if 8 <= frame < 18 else [0]
        found.append(stepped(theta[frame, characters], BETAS[characters])[-1])
        if frame == 9:
            joined = stepped.state[0]
    np.testing.assert_allclose(found, alone, atol=2e-6)
    stepped.state = stepped.none(1)
    for frame in (8, 9):
        stepped(theta[frame, 1:], BETAS[1:])
    np.testing.assert_allclose(joined, stepped.state[0], atol=2e-5, rtol=1e-4)


def test_another_shape_begins_anew(stepped):
    theta = motion(1)[:, None]
    stepped.clip(theta, BETAS[1:])
    kept = stepped.state
    changed = stepped(theta[-1], BETAS[:1])
    stepped.state = stepped.none(1)
    np.testing.assert_allclose(changed, stepped(theta[-1], BETAS[:1]), atol=1e-6)
    assert not np.allclose(kept, stepped.state)


def test_far_from_the_origin_tissue_moves_the_same(flesh, stepped):
    theta = motion(0)
    far = theta.copy()
    far[:, 66] += 64.0  # a power of two: the numbers in the file lose nothing but digits of 67
    near_m, far_m = (stepped.clip(path[:, None], BETAS[:1])[:, 0] for path in (theta, far))
    np.testing.assert_allclose(far_m - [64.0, 0, 0], near_m, atol=3e-5)


@pytest.mark.parametrize("static", [False, True])
def test_parts_posed_are_the_vertices(flesh, static):
    model = with_static(flesh) if static else flesh
    theta, whole = two(), Stepped(plus_graph(model, BODY))
    run = GraphSession(plus_graph(model, BODY, in_parts=True))
    expected, state = whole.clip(theta, BETAS), whole.none(len(BETAS))
    for frame, vertices in zip(theta, expected, strict=True):
        found = run(theta=frame, betas=BETAS, state=state)
        state = found["next_state"]
        bones = (found["bones"] @ bone_weights(BODY).T).reshape(2, 4, 3, -1)
        moved = found["rest"] + found["offsets"]
        posed = (bones[:, :3] * moved[:, :, None]).sum(axis=1) + bones[:, 3]
        np.testing.assert_allclose(posed.transpose(0, 2, 1), vertices, atol=2e-6)
    assert np.abs(found["offsets"]).max() > 1e-3
