"""Posing inside a graph is the float64 oracle's."""

from __future__ import annotations

import numpy as np
import pytest

from bridge.body import BodyModelData, load_body_model, pose_vertices
from bridge.motion import unpack_theta
from dsnet.onnx.body_graph import Surface, posed_bones, translated, translation
from dsnet.onnx.onnx_graph import Graph, GraphSession

BODY = load_body_model("embedded:female")


def posed(body: BodyModelData, theta: np.ndarray, betas: np.ndarray) -> np.ndarray:
    graph = Graph()
    given, shape = graph.input("theta", ("B", 69)), graph.input("betas", ("B", 10))
    bones, features = posed_bones(graph, body, given, shape)
    skin = Surface(graph, body, slice(None))
    moved = translated(graph, bones, translation(given))
    vertices = skin.skinned(moved, skin.rest(features, shape))
    model = graph.model("body", {"vertices": vertices}, {"vertices": ("B", body.vertex_count, 3)})
    return GraphSession(model)(theta=theta.astype(np.float32), betas=betas.astype(np.float32))[
        "vertices"
    ]


@pytest.mark.parametrize("angle", [0.0, 1e-6, 1e-3, 0.7, np.pi, 11.0])
def test_posed_vertices_are_the_oracles(angle):
    rng = np.random.default_rng(2)
    vectors = rng.normal(size=(3, 22, 3))
    vectors *= angle / np.linalg.norm(vectors, axis=-1, keepdims=True)
    theta = np.concatenate([vectors.reshape(3, 66), rng.normal(size=(3, 3))], axis=1)
    theta, betas = theta.astype(np.float32), rng.normal(size=(3, 10)).astype(np.float32)
    expected = pose_vertices(BODY, betas, *unpack_theta(theta.astype(np.float64)))
    # Angles of 11 rad are known to 1e-6 in float32, and limbs are 1 m long.
    np.testing.assert_allclose(posed(BODY, theta, betas), expected, atol=5e-6)


def test_weights_of_hands_are_their_wrists():
    assert BODY.weights[:, 22:].any()
    theta, betas = np.zeros((1, 69)), np.zeros((1, 10))
    theta[0, 60:66] = 0.8
    expected = pose_vertices(BODY, betas, *unpack_theta(theta.astype(np.float32)))
    np.testing.assert_allclose(posed(BODY, theta, betas), expected, atol=2e-6)


@pytest.mark.parametrize("count", [5, 6, 8])
def test_groups_of_any_size_give_every_character_her_own(count):
    rng = np.random.default_rng(count)
    theta, betas = rng.normal(0, 0.5, (count, 69)), rng.normal(size=(count, 10))
    expected = pose_vertices(BODY, betas, *unpack_theta(theta))
    np.testing.assert_allclose(posed(BODY, theta, betas), expected, atol=5e-6)
