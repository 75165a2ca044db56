"""Trained networks in Keras's and TensorFlow's own files: `.keras`, SavedModel, TensorFlow Lite.

Each takes motions as `bridge` has them and gives the autoencoder's latents: where the network was
trained on standardised values, its first and last layers hold the scaling. All layers are Keras's
own, so that a program needs nothing of this project to open them.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from zipfile import ZipFile, ZipInfo

import numpy as np

from bridge.errors import DsnetError
from bridge.exchange.dsnet import Scaling, TrainedDsnet
from tf_dsnet.framework import Tensor, keras, quietly, tf
from tf_dsnet.layers import NoChain, layers_of
from tf_dsnet.model import assign_weights, build_dsnet, with_own_names

_SCALING = "standardise", "restore"
"""Names of the first and the last layer, where there is a scaling."""


def stock_network(
    trained: TrainedDsnet, build: Callable[..., keras.Model] = build_dsnet
) -> keras.Model:
    """A trained network (B, T, 79) -> (B, T, 100) from betas and theta to latents.

    `build` is what it was built by; of the paper's network 65,140 parameters.
    """
    scaling, size = trained.scaling, len(trained.scaling.input_mean)
    network = with_own_names(build(input_size=size))
    assign_weights(network, trained.weights)
    if _is_identity(scaling):
        return network
    normalization = keras.layers.Normalization
    standardise = normalization(
        mean=scaling.input_mean, variance=scaling.input_std**2, name=_SCALING[0]
    )
    restore = normalization(
        mean=scaling.latent_mean, variance=scaling.latent_std**2, invert=True, name=_SCALING[1]
    )
    motion = keras.Input((None, size), name="motion")
    return keras.Model(motion, restore(network(standardise(motion))), name=trained.name)


def save_keras(network: keras.Model, path: Path) -> None:
    """As `network.save(path)`, with the same bytes each time: Keras writes the date and addresses
    in memory into it."""
    network.save(path)
    with ZipFile(path) as saved:
        contents = {name: saved.read(name) for name in sorted(saved.namelist())}
    with ZipFile(path, "w") as again:
        for name, content in contents.items():
            if name.endswith(".json"):
                content = json.dumps(_same_each_time(json.loads(content), {})).encode()
            again.writestr(ZipInfo(name), content)


def _same_each_time(value: Any, numbers: dict[int, int]) -> Any:
    """JSON without the date, and with objects numbered in their order."""
    if isinstance(value, list):
        return [_same_each_time(one, numbers) for one in value]
    if not isinstance(value, dict):
        return value
    same = {key: _same_each_time(one, numbers) for key, one in value.items()}
    same.pop("date_saved", None)
    if (shared := same.get("shared_object_id")) is not None:
        same["shared_object_id"] = numbers.setdefault(shared, len(numbers))
    return same


def write_savedmodel(path: Path, saved: Path) -> None:
    """A `.keras` file as a SavedModel: `tf.saved_model.load(path).serve(motion)`."""
    with quietly():
        _loaded(saved).export(path, verbose=False)


def write_tflite(path: Path, saved: Path) -> None:
    """A `.keras` file as a TensorFlow Lite graph of one frame, without Flex operations.

    Inputs: `motion` (1, 79) and `state_0`, `state_1`, ..., of an LSTM its hidden and its memory
    state (1, 60), zeros at first. Outputs: `latents` (1, 100) and the states for the next frame.
    A graph of whole motions would need TensorFlow's own loops beside TensorFlow Lite.
    """
    with tempfile.TemporaryDirectory() as folder, quietly():
        step_network(_loaded(saved)).export(folder, verbose=False)
        path.write_bytes(tf.lite.TFLiteConverter.from_saved_model(folder).convert())


def step_network(network: keras.Model) -> keras.Model:
    """The same layers for one frame: from `motion` (1, 79) and states to `latents` and states.

    DsnetError unless they are a chain of layers that see one frame, and remember in states alone.
    """
    motion: Tensor = keras.Input(batch_shape=(1, network.inputs[0].shape[-1]), name="motion")
    inputs, outputs, value = [motion], {}, motion
    for layer in _chain(network):
        if not isinstance(layer, keras.layers.RNN):
            value = keras.ops.squeeze(layer(keras.ops.expand_dims(value, 1)), 1)
            continue
        sizes = layer.cell.state_size
        states: list[Tensor] = [
            keras.Input(batch_shape=(1, size), name=f"state_{len(outputs) + number}")
            for number, size in enumerate(sizes if isinstance(sizes, (list, tuple)) else [sizes])
        ]
        inputs += states
        value, after = layer.cell(value, states)
        outputs |= {state.name: new for state, new in zip(states, after, strict=True)}
    return keras.Model(inputs, {"latents": value, **outputs}, name=f"{network.name}_step")


def _is_identity(scaling: Scaling) -> bool:
    shifts = scaling.input_mean, scaling.latent_mean
    factors = scaling.input_std, scaling.latent_std
    return not any(map(np.any, shifts)) and all(np.all(factor == 1) for factor in factors)


def _loaded(saved: Path) -> keras.Model:
    """The network in a `.keras` file; DsnetError if it needs classes of its own."""
    try:
        network: Any = keras.models.load_model(saved, compile=False)
    except (TypeError, ValueError, OSError) as error:
        raise DsnetError(
            f"{saved}, which Keras does not open ({str(error).splitlines()[0][:120]})",
            "a network of Keras's own layers",
            "Import the module of its layers, and load it with keras.models.load_model.",
        ) from error
    return network


def _chain(network: keras.Model) -> list[keras.layers.Layer]:
    """All layers in their order, those that scale around those that were trained."""
    before, trained, after = [], network, []
    match [one for one in network.layers if not isinstance(one, keras.layers.InputLayer)]:
        case [first, keras.Model() as inner, last] if (first.name, last.name) == _SCALING:
            before, trained, after = [first], inner, [last]
    try:
        names = [layer.name for layer in layers_of(trained)]
    except NoChain as reason:
        raise DsnetError(
            f"network {network.name!r}, {reason}",
            "a chain of layers that see a frame at a time",
            "Export it as keras or savedmodel, which take whole motions.",
        ) from reason
    return [*before, *map(trained.get_layer, names), *after]
