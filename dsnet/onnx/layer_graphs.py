"""One step of a chain of layers as an ONNX graph, straight from named arrays."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from bridge.exchange.dsnet import TrainedDsnet
from bridge.exchange.layers import RECURRENT, Layer
from dsnet.onnx.onnx_graph import Graph, StateLayout, Value

Arrays = Mapping[str, NDArray[np.float64]]
Affine = tuple[NDArray[np.floating], NDArray[np.floating]]
"""A kernel (I, O) and a bias (O,)."""
_STILL = "nothing"


def dsnet_layout(network: TrainedDsnet) -> StateLayout:
    """What a character's row holds: the memory of each recurrent layer, a zero if there is none."""
    recurrent = [layer for layer in network.layers if layer.kind in RECURRENT]
    shapes: dict[str, tuple[int, ...]] = {}
    for layer in recurrent:
        units = len(network.weights[f"{layer.name}/recurrent_kernel"])
        names = ("hidden", "cell") if layer.kind == "LSTM" else ("hidden",)
        prefix = f"{layer.name}/" if len(recurrent) > 1 else ""
        shapes |= {f"{prefix}{name}": (units,) for name in names}
    return StateLayout(shapes or {_STILL: (1,)})


def stepped(
    graph: Graph, network: TrainedDsnet, inputs: Value, past: Mapping[str, Value]
) -> tuple[Value, dict[str, Value]]:
    """Latents (B, 100) of inputs (B, 79) in a motion's own units, and the memory after them.

    What is affine and follows one another, scalings included, is folded together once.
    """
    scale, after = network.scaling, dict(past)
    many = sum(layer.kind in RECURRENT for layer in network.layers) > 1
    chain = _Chain(graph, inputs)
    with graph.section("dsnet"):
        chain.fold((np.diag(1.0 / scale.input_std.astype(np.float64)),
                    -scale.input_mean.astype(np.float64) / scale.input_std))  # fmt: skip
        for layer in network.layers:
            held = f"{layer.name}/"
            arrays = {
                name.removeprefix(held): array.astype(np.float64)
                for name, array in network.weights.items()
                if name.startswith(held)
            }
            if layer.kind in RECURRENT:
                prefix = held if many else ""
                before = {
                    n.removeprefix(prefix): v for n, v in past.items() if n.startswith(prefix)
                }
                found = _RECURRENT[layer.kind](graph, layer, arrays, chain.value(held), before)
                after |= {prefix + name: value for name, value in found.items()}
                chain = _Chain(graph, found["hidden"])
            else:
                chain.follow(layer, arrays)
        chain.fold((np.diag(scale.latent_std.astype(np.float64)), scale.latent_mean))
        return chain.value("latents/"), after


class _Chain:
    """A value, and what is affine after it and not yet part of the graph."""

    def __init__(self, graph: Graph, value: Value) -> None:
        self._graph, self._value = graph, value
        self._affine: Affine | None = None

    def fold(self, following: Affine) -> None:
        """Let an affine map follow."""
        kernel, bias = following
        if self._affine is not None:
            before, moved = self._affine
            kernel, bias = before @ kernel, moved @ kernel + bias
        self._affine = kernel, bias

    def value(self, name: str) -> Value:
        """What there is so far; its arrays are `<name>folded_...`."""
        if self._affine is not None:
            kernel, bias = self._affine
            self._value = _affine(self._graph, f"{name}folded_", self._value, kernel, bias)
            self._affine = None
        return self._value

    def follow(self, layer: Layer, arrays: Arrays) -> None:
        """Let a layer without a memory follow."""
        if layer.kind == "Dense":
            kernel = arrays["kernel"]
            self.fold((kernel, arrays.get("bias", np.zeros(kernel.shape[1]))))
        elif layer.kind == "BatchNormalization":
            mean, variance = arrays["moving_mean"], arrays["moving_variance"]
            gain = arrays.get("gamma", 1.0) / np.sqrt(variance + layer.epsilon)
            self.fold((np.diag(gain), arrays.get("beta", 0.0) - gain * mean))
        elif layer.kind == "LayerNormalization":
            value = self.value(f"{layer.name}/")
            self._value = _normalised(self._graph, layer, arrays, value)
        if layer.activation != "linear":
            self._value = _ACTIVATED[layer.activation](self.value(f"{layer.name}/"))


def _affine(graph: Graph, name: str, value: Value, kernel: NDArray, bias: NDArray) -> Value:
    return value @ graph.array(f"{name}kernel", kernel) + graph.array(f"{name}bias", bias)


def _normalised(graph: Graph, layer: Layer, arrays: Arrays, value: Value) -> Value:
    """(B, O) of the numbers of each row, by their mean and spread."""
    mean = graph.apply("ReduceMean", value, axes=[1], keepdims=1)
    from_mean = value - mean
    variance = graph.apply("ReduceMean", from_mean * from_mean, axes=[1], keepdims=1)
    found = from_mean / graph.apply("Sqrt", variance + layer.epsilon)
    if "gamma" in arrays:
        found = found * graph.array(f"{layer.name}/gamma", arrays["gamma"])
    if "beta" in arrays:
        found = found + graph.array(f"{layer.name}/beta", arrays["beta"])
    return found


def _gelu(value: Value) -> Value:
    return 0.5 * value * (1.0 + value.graph.apply("Erf", value * (1 / math.sqrt(2))))


_ACTIVATED: dict[str, Callable[[Value], Value]] = {
    "linear": lambda value: value,
    "tanh": lambda value: value.graph.apply("Tanh", value),
    "relu": lambda value: value.graph.apply("Relu", value),
    "sigmoid": lambda value: value.graph.apply("Sigmoid", value),
    "elu": lambda value: value.graph.apply("Elu", value),
    "gelu": _gelu,
}


def _lstm(
    graph: Graph, layer: Layer, arrays: Arrays, value: Value, past: Mapping[str, Value]
) -> dict[str, Value]:
    """All four gates come from one tanh, as sigmoid(z) = (1 + tanh(z / 2)) / 2."""
    units = len(arrays["recurrent_kernel"])
    # Keras's order: input, forget, candidate, output.
    halved = np.repeat([0.5, 0.5, 1.0, 0.5], units)
    kernel = np.vstack([arrays["kernel"], arrays["recurrent_kernel"]])
    bias = arrays.get("bias", np.zeros(4 * units))
    known = graph.concat([value, past["hidden"]], 1)
    gates = _affine(graph, f"{layer.name}/", known, kernel * halved, bias * halved)
    i, f, candidate, o = graph.apply("Tanh", gates).split(1, [units] * 4)
    i, f, o = (0.5 + 0.5 * gate for gate in (i, f, o))
    cell = f * past["cell"] + i * candidate
    return {"hidden": o * graph.apply("Tanh", cell), "cell": cell}


def _gru(
    graph: Graph, layer: Layer, arrays: Arrays, value: Value, past: Mapping[str, Value]
) -> dict[str, Value]:
    """The gate of resetting acts after the product with the memory."""
    units, hidden = len(arrays["recurrent_kernel"]), past["hidden"]
    of_input, of_memory = arrays.get("bias", np.zeros((2, 3 * units)))
    # Keras's order: update, reset, candidate.
    told = _affine(graph, f"{layer.name}/", value, arrays["kernel"], of_input)
    known = _affine(
        graph, f"{layer.name}/recurrent_", hidden, arrays["recurrent_kernel"], of_memory
    )
    told_gates, told_candidate = told.split(1, [2 * units, units])
    known_gates, known_candidate = known.split(1, [2 * units, units])
    update, reset = graph.apply("Sigmoid", told_gates + known_gates).split(1, [units] * 2)
    candidate = graph.apply("Tanh", told_candidate + reset * known_candidate)
    return {"hidden": candidate + update * (hidden - candidate)}


def _simple_rnn(
    graph: Graph, layer: Layer, arrays: Arrays, value: Value, past: Mapping[str, Value]
) -> dict[str, Value]:
    kernel = np.vstack([arrays["kernel"], arrays["recurrent_kernel"]])
    bias = arrays.get("bias", np.zeros(kernel.shape[1]))
    known = graph.concat([value, past["hidden"]], 1)
    return {"hidden": _ACTIVATED[layer.activation](
        _affine(graph, f"{layer.name}/", known, kernel, bias)
    )}  # fmt: skip


_RECURRENT = {"LSTM": _lstm, "GRU": _gru, "SimpleRNN": _simple_rnn}
