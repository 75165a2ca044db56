"""The Keras layer against the reference, and its gradients against differences."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bridge.body import BodyModelData
from bridge.tissue.node_clips import NodeClip
from bridge.tissue.nodes import TissueNodes
from bridge.tissue.shape import shape_features, shaped_normals
from bridge.tissue.trained_plus import StaticPart, TrainedPlus, shares_of_people
from dsnet.verify.reference.oscillators import node_offsets
from tests.forged.oscillating import clips_of, people_of, true_model
from tf_dsnet.framework import tf
from tf_dsnet.oscillators import OscillatorLayer

NODES, PEOPLE = 60, 3


@pytest.fixture(scope="module")
def nodes(body: BodyModelData) -> TissueNodes:
    return TissueNodes.of(body, NODES)


def drawn_layer(nodes: TissueNodes, taps: int) -> OscillatorLayer:
    """Weights of which none is at its start."""
    layer = OscillatorLayer(nodes.laplacian.toarray(), PEOPLE, taps)
    named(layer)["log_sag"].assign([np.log(0.04)])
    rng = np.random.default_rng(0)
    for weight in layer.trainable_variables:
        scale = 0.1 if weight.name != "taps" else 0.1 / taps
        weight.assign_add(rng.normal(scale=scale, size=weight.shape).astype(np.float32))
    return layer


def named(layer: OscillatorLayer) -> dict[str, Any]:
    return {variable.name: variable for variable in layer.trainable_variables}


def window(array: np.ndarray, start: int, count: int) -> np.ndarray:
    return array[np.clip(np.arange(start, start + count), 0, len(array) - 1)]


def inputs(body, nodes, clips: list[NodeClip], starts, frames: int, taps: int, ahead: int):
    """What the layer is called with, from frame 0, one clip beside the other."""
    people = people_of(PEOPLE)
    features = [shape_features(body, people[c.person], nodes.vertices) for c in clips]
    normals = [shaped_normals(body, people[c.person])[nodes.vertices] for c in clips]
    shares = [shares_of_people(people[c.person], people) for c in clips]
    felt = [
        np.stack(
            [window(getattr(c.load, kind), ahead - taps + 1, frames + taps - 1) for c in clips], 2
        )
        for kind in ("inertia", "gravity")
    ]
    state = np.stack(starts, 1)
    parts = [*felt, state, state, np.stack(normals, 1), np.stack(features, 1), np.stack(shares)]
    return [tf.constant(part, tf.float32) for part in parts]


@pytest.mark.parametrize(("taps", "ahead"), [(3, 1), (4, 0)])
def test_layer_is_the_sheet_for_several_people_at_once(body, nodes, taps, ahead):
    layer = drawn_layer(nodes, taps)
    people = people_of(PEOPLE)
    trained = TrainedPlus(nodes, layer.weights_as_arrays(), StaticPart.nothing(), people, ahead)
    clips = clips_of(body, true_model(nodes, people), frames=50)
    chosen = [clips[0], clips[4], clips[8], clips[2]]
    assert {c.person for c in chosen} == {0, 1, 2}
    expected = []
    for clip in chosen:
        expected.append(node_offsets(trained, body, clip.theta, people[clip.person]))
    starts = [rolled[0] for rolled in expected]
    found = layer(*inputs(body, nodes, chosen, starts, 49, taps, ahead)).numpy()
    assert found.shape == (49, NODES, 4, 3)
    for column, rolled in enumerate(expected):
        assert np.abs(rolled).max() > 1e-3
        np.testing.assert_allclose(found[:, :, column], rolled[1:], atol=1e-5)


def test_what_all_people_share_is_nobodys_own(nodes):
    """So a stranger, who takes after nobody, is not stiffer or softer than those who are known."""
    layer = drawn_layer(nodes, 3)
    before = layer.weights_as_arrays()
    np.testing.assert_allclose(before.residual.mean(0), 0.0, atol=1e-7)
    assert np.abs(before.residual).max() > 0.1
    named(layer)["residual"].assign_add(np.full((PEOPLE, NODES, 1), 0.5, np.float32))
    after = layer.weights_as_arrays()
    np.testing.assert_allclose(after.residual, before.residual, atol=1e-6)


def test_penalty_grows_with_unevenness(nodes):
    even, uneven = OscillatorLayer(nodes.laplacian.toarray(), PEOPLE, 3), drawn_layer(nodes, 3)
    assert 0.0 <= float(even.penalty()) < float(uneven.penalty())
