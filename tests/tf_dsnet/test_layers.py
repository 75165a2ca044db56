"""A network of somebody's own: its layers as plain words, step by step what Keras says."""

from __future__ import annotations

import json
from functools import partial

import numpy as np
import pytest

from bridge.exchange.dsnet import Scaling, TrainedDsnet, join_inputs
from bridge.exchange.layers import DSNET_LAYERS, KINDS, layers_as_json, layers_from_json
from dsnet.stream.streaming_predictor import StreamingPredictor
from tf_dsnet.framework import keras
from tf_dsnet.layers import NoChain, layers_of
from tf_dsnet.model import BlockLSTM, build_dsnet, named_weights, with_own_names
from tf_dsnet.predictors import applied_dsnet

L = keras.layers
RNG = np.random.default_rng(6)
THETA, BETAS = RNG.normal(0, 0.4, (1, 40, 69)), RNG.normal(0, 1, (1, 10))
CHAINS = {
    "gru": [partial(L.Dense, 24, "relu"), partial(L.GRU, 20, return_sequences=True)],
    "two recurrent": [
        partial(L.LSTM, 16, return_sequences=True),
        partial(L.GRU, 12, return_sequences=True, use_bias=False),
    ],
    "simple": [
        partial(L.SimpleRNN, 16, activation="relu", return_sequences=True),
        partial(L.LayerNormalization),
        partial(L.Dropout, 0.5),
        partial(L.Dense, 9, "elu"),
        partial(L.Dense, 9, "gelu", use_bias=False),
    ],
    "no memory": [
        partial(L.Dense, 16),
        partial(L.BatchNormalization, scale=False),
        partial(L.Activation, "sigmoid"),
        partial(L.LayerNormalization, center=False),
    ],
}


def build(layers, input_size=79):
    return keras.Sequential([keras.Input((None, input_size)), *(f() for f in layers), L.Dense(100)])


@pytest.mark.parametrize("chain", CHAINS.values(), ids=CHAINS)
def test_step_by_step_is_the_whole_clip_of_any_chain(chain):
    model = with_own_names(build(chain))
    for variable in model.weights:
        moved = variable.numpy() + RNG.normal(0, 0.2, variable.shape)
        variable.assign(np.abs(moved) if variable.name == "moving_variance" else moved)
    scaling = Scaling.fitted(RNG.normal(1, 2, (50, 79)), RNG.normal(-1, 2, (50, 100)), 0.05)
    layers = layers_from_json(json.loads(json.dumps(layers_as_json(layers_of(model)))))
    trained = TrainedDsnet("own", named_weights(model), scaling, layers)
    whole = applied_dsnet(trained, partial(build, chain))(join_inputs(THETA[0], BETAS[0]))
    stream = StreamingPredictor(trained)
    found = np.concatenate([stream.step(frame, BETAS) for frame in THETA.swapaxes(0, 1)])
    np.testing.assert_allclose(found, whole, rtol=1e-5, atol=1e-5 * np.abs(whole).max())
    assert np.ptp(whole, axis=0).max() > 0.1


def test_every_kind_stands_in_a_chain_above():
    found = {layer.kind for chain in CHAINS.values() for layer in layers_of(build(chain))}
    assert found == {*KINDS}


@pytest.mark.parametrize("masked", [True, False])
def test_the_papers_network_is_a_chain(masked):
    assert layers_of(build_dsnet(masked=masked, lstm_layer=BlockLSTM)) == DSNET_LAYERS
    narrow = build_dsnet(widths={"lstm": 8})
    assert narrow.get_layer("lstm").units == 8
    assert narrow.get_layer("fc_enc_3").units == 100


def test_names_of_weights_do_not_depend_on_what_was_built_before():
    first, second = (named_weights(with_own_names(build(CHAINS["gru"]))) for _ in range(2))
    assert [*first] == [*second]
    assert "gru/kernel" in first


REFUSED = {
    "'window' is a Conv1D": [partial(L.Conv1D, 4, 2, padding="causal", name="window")],
    "activation": [partial(L.Dense, 4, "softplus")],
    "reset_after=False": [partial(L.GRU, 4, reset_after=False, return_sequences=True)],
    "Bidirectional": [lambda: L.Bidirectional(L.GRU(4, return_sequences=True))],
}


@pytest.mark.parametrize("words", REFUSED)
def test_a_layer_that_is_not_known_is_named(words):
    with pytest.raises(NoChain, match=words):
        layers_of(build(REFUSED[words]))


def test_a_branch_is_no_chain():
    motion = keras.Input((None, 79))
    sides = [L.Dense(100, name=name)(motion) for name in ("left", "right")]
    with pytest.raises(NoChain, match="'right' does not follow"):
        layers_of(keras.Model(motion, L.Add()(sides)))
