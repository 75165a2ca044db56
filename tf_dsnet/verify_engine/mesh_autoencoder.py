"""The mesh autoencoder in Keras: every layer, and training by PyTorch's Adam."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bridge.exchange.weights import TORCH_ADAM, mesh_autoencoder_from_keras
from bridge.verify.answers import layers, learn
from bridge.verify.protocol import Case, Tensors
from tf_dsnet.codec import KerasCodec
from tf_dsnet.framework import Tensor, keras, tf
from tf_dsnet.mesh_autoencoder import (
    KerasMeshAutoencoder,
    TorchAdam,
    assign_weights,
    named_variables,
    named_weights,
)
from tf_dsnet.verify_engine.precision import compute_in, exact


def forward(case: Case) -> Tensors:
    """Every layer, and the normaliser's where the case is in metres."""
    weights = case.weights()
    scaling = [weights.pop(f"normaliser.{name}", np.empty(0)) for name in ("mean_m", "scale_m")]
    network = build(case, weights)
    encoder, decoder = _traced(network.encoder), _traced(network.decoder)

    def run(values: Tensor) -> dict[str, Tensor]:
        encoded = _seen(network.encoder, encoder(values))
        return encoded | _seen(network.decoder, decoder(encoded["to_latent"]))

    if not case.options.get("metres"):
        return layers(case, run, case.inputs()["values"])
    codec = KerasCodec(network, *scaling)

    def run_in_metres(offsets_m: Tensor) -> dict[str, Tensor]:
        values = codec.normalise(offsets_m)
        seen = {"normaliser.normalise": values, **run(values)}
        return seen | {"normaliser.denormalise": codec.denormalise(seen["to_coordinates"])}

    return layers(case, run_in_metres, case.inputs()["offsets_m"])


def train(case: Case) -> Tensors:
    """Loss and gradients of the reconstruction of one batch, and steps on it."""
    return learn(case, _AutoencoderLearner(case))


def build(case: Case, weights: Tensors) -> KerasMeshAutoencoder:
    """The twin in the case's precision, with these weights."""
    compute_in(case.dtype)
    network = KerasMeshAutoencoder(**case.options["architecture"])
    assign_weights(network.model, weights)
    return network


class _AutoencoderLearner:
    def __init__(self, case: Case) -> None:
        self._model = build(case, case.weights()).model
        given = {name: tf.constant(array) for name, array in case.inputs().items()}
        self._values, self._target = given["values"], given.get("target", given["values"])
        rate = case.options["adam"]["learning_rate"]
        self._adam = TorchAdam(replace(TORCH_ADAM, learning_rate=rate))
        exact(self._adam)

    def first_pass(self) -> tuple[float, Tensors]:
        loss, gradients = self._pass()
        return loss, self._canonical(gradients)

    def step(self) -> float:
        loss, gradients = self._pass()
        self._adam.apply(gradients, self._model.trainable_variables)
        return loss

    def state(self) -> dict[str, Tensors]:
        moments = {
            kind: self._canonical([v for v in self._adam.variables if v.path.endswith(end)])
            for kind, end in (("adam_m", "_momentum"), ("adam_v", "_velocity"))
        }
        return {"weight": named_weights(self._model), **moments}

    def _pass(self) -> tuple[float, list[Tensor]]:
        with tf.GradientTape() as tape:
            loss = tf.reduce_mean(tf.square(self._model(self._values) - self._target))
        return float(loss), tape.gradient(loss, self._model.trainable_variables)

    def _canonical(self, variables: list[Tensor]) -> Tensors:
        pairs = zip(named_variables(self._model), variables, strict=True)
        return mesh_autoencoder_from_keras({name: value.numpy() for name, value in pairs})


def _traced(part: keras.Model) -> keras.Model:
    outputs = {layer.name: layer.output for layer in _named_layers(part)}
    return keras.Model(part.inputs, outputs)


def _seen(part: keras.Model, outputs: dict[str, Tensor]) -> dict[str, Tensor]:
    """Outputs in the layers' order, features last as everywhere but inside the convolutions."""
    return {
        layer.name: tf.transpose(outputs[layer.name], (0, 2, 1))
        if ".conv_" in layer.name
        else outputs[layer.name]
        for layer in _named_layers(part)
    }


def _named_layers(part: keras.Model) -> list[keras.Layer]:
    """Linear layers and nonlinearities; what only moves numbers has no counterpart elsewhere."""
    moving = (
        keras.layers.InputLayer,
        keras.layers.Flatten,
        keras.layers.Reshape,
        keras.layers.Permute,
    )
    return [layer for layer in part.layers if not isinstance(layer, moving)]
