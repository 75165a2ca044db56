"""Describes a Keras model as a chain of layers, if it is one."""

from __future__ import annotations

from typing import Any

from bridge.exchange.layers import ACTIVATIONS, KINDS, RECURRENT, Layer
from bridge.paper import INPUT_SIZE
from tf_dsnet.framework import keras
from tf_dsnet.model import BlockLSTM


class NoChain(Exception):
    """The model is not a chain of supported layers; the message is a clause that says why."""


_KIND_OF = {getattr(keras.layers, kind): kind for kind in KINDS} | {BlockLSTM: "LSTM"}
"""By exact class, as a subclass may compute something else."""
_REQUIRED_OPTIONS: dict[str, dict[str, Any]] = {
    "LSTM": {"activation": "tanh", "recurrent_activation": "sigmoid"},
    "GRU": {"activation": "tanh", "recurrent_activation": "sigmoid", "reset_after": True},
    "LayerNormalization": {"rms_scaling": False},
}


def layers_of(model: keras.Model) -> tuple[Layer, ...]:
    """The layers of a functional or sequential model, in order; `NoChain` if it is not a chain.

    A second input, the mask of real frames, and dropout do not affect predictions.
    """
    if not getattr(model, "inputs", None):
        raise NoChain("which is a subclassed model, not a graph of layers")
    if (size := model.inputs[0].shape[-1]) != INPUT_SIZE:
        raise NoChain(f"whose input has {size} numbers a frame, not betas and theta alone")
    chain, before = [], model.inputs[0]
    other_inputs = {id(tensor) for tensor in model.inputs[1:]}
    for layer in model.layers:
        if isinstance(layer, keras.layers.InputLayer):
            continue
        given = layer.input if isinstance(layer.input, (list, tuple)) else [layer.input]
        previous = [tensor for tensor in given if id(tensor) not in other_inputs]
        if len(previous) != 1 or previous[0] is not before:
            raise NoChain(f"whose layer {layer.name!r} does not follow the one before it alone")
        chain.append(_described(layer))
        before = layer.output
    if before is not model.outputs[0]:
        raise NoChain("whose output is not its last layer's")
    return tuple(chain)


def _described(layer: keras.layers.Layer) -> Layer:
    kind, config = _KIND_OF.get(type(layer), ""), layer.get_config()
    if not kind:
        raise NoChain(f"whose layer {layer.name!r} is a {type(layer).__name__}")
    required = dict(_REQUIRED_OPTIONS.get(kind, {}))
    if kind in RECURRENT:
        required |= {"return_sequences": True, "go_backwards": False, "stateful": False}
    if "axis" in config:
        axis = config["axis"][0] if isinstance(config["axis"], (list, tuple)) else config["axis"]
        config["axis"], required["axis"] = axis % 3, 2  # of (B, T, features)
    for option, value in required.items():
        if config.get(option, value) != value:
            raise NoChain(f"whose layer {layer.name!r} has {option}={config[option]!r}")
    activation = config.get("activation", "linear")
    if activation not in ACTIVATIONS:
        raise NoChain(f"whose layer {layer.name!r} has the activation {activation!r:.60}")
    return Layer(kind, layer.name, activation, float(config.get("epsilon", 0.0)))
