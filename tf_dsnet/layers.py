"""A Keras model as a chain of layers in plain words, where it is one."""

from __future__ import annotations

from typing import Any

from bridge.exchange.layers import ACTIVATIONS, KINDS, RECURRENT, Layer
from bridge.paper import INPUT_SIZE
from tf_dsnet.framework import keras
from tf_dsnet.model import BlockLSTM


class NoChain(Exception):
    """Why a model is no chain of known layers, a clause."""


_KIND_OF = {getattr(keras.layers, kind): kind for kind in KINDS} | {BlockLSTM: "LSTM"}
"""By exact class: what inherits from one may compute something else."""
_NEEDED: dict[str, dict[str, Any]] = {
    "LSTM": {"activation": "tanh", "recurrent_activation": "sigmoid"},
    "GRU": {"activation": "tanh", "recurrent_activation": "sigmoid", "reset_after": True},
    "LayerNormalization": {"rms_scaling": False},
}


def layers_of(model: keras.Model) -> tuple[Layer, ...]:
    """The layers of a functional or sequential model, each of the one before.

    A second input, which frames are real, and dropout change nothing in a prediction.
    """
    if not getattr(model, "inputs", None):
        raise NoChain("which is a class of its own, not a graph of layers")
    if (size := model.inputs[0].shape[-1]) != INPUT_SIZE:
        raise NoChain(f"which is told {size} numbers of a frame, not betas and theta alone")
    found, before = [], model.inputs[0]
    inputs = {id(tensor) for tensor in model.inputs[1:]}
    for layer in model.layers:
        if isinstance(layer, keras.layers.InputLayer):
            continue
        given = layer.input if isinstance(layer.input, (list, tuple)) else [layer.input]
        others = [tensor for tensor in given if id(tensor) not in inputs]
        if len(others) != 1 or others[0] is not before:
            raise NoChain(f"whose layer {layer.name!r} does not follow the one before it alone")
        found.append(_described(layer))
        before = layer.output
    if before is not model.outputs[0]:
        raise NoChain("whose output is not its last layer's")
    return tuple(found)


def _described(layer: keras.layers.Layer) -> Layer:
    kind, config = _KIND_OF.get(type(layer), ""), layer.get_config()
    if not kind:
        raise NoChain(f"whose layer {layer.name!r} is a {type(layer).__name__}")
    needed = dict(_NEEDED.get(kind, {}))
    if kind in RECURRENT:
        needed |= {"return_sequences": True, "go_backwards": False, "stateful": False}
    if "axis" in config:
        axis = config["axis"][0] if isinstance(config["axis"], (list, tuple)) else config["axis"]
        config["axis"], needed["axis"] = axis % 3, 2  # of (B, T, features)
    for option, value in needed.items():
        if config.get(option, value) != value:
            raise NoChain(f"whose layer {layer.name!r} has {option}={config[option]!r}")
    activation = config.get("activation", "linear")
    if activation not in ACTIVATIONS:
        raise NoChain(f"whose layer {layer.name!r} has the activation {activation!r:.60}")
    return Layer(kind, layer.name, activation, float(config.get("epsilon", 0.0)))
