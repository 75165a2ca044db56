"""One step of a chain of layers as an ONNX graph, made from named arrays."""

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
_NO_STATE = "nothing"


def dsnet_layout(network: TrainedDsnet) -> StateLayout:
    """State of one character: that of each recurrent layer, or a zero if there is no such layer."""
    recurrent = [layer for layer in network.layers if layer.kind in RECURRENT]
    shapes: dict[str, tuple[int, ...]] = {}
    for layer in recurrent:
        units = len(network.weights[f"{layer.name}/recurrent_kernel"])
        names = ("hidden", "cell") if layer.kind == "LSTM" else ("hidden",)
        prefix = f"{layer.name}/" if len(recurrent) > 1 else ""
        shapes |= {f"{prefix}{name}": (units,) for name in names}
    return StateLayout(shapes or {_NO_STATE: (1,)})


def dsnet_step(
    graph: Graph, network: TrainedDsnet, inputs: Value, past: Mapping[str, Value]
) -> tuple[Value, dict[str, Value]]:
    """Latents (B, 100) of unscaled inputs (B, 79), and the recurrent state after them.

    Consecutive affine layers, scalings included, are folded into one.
    """
    scale, after = network.scaling, dict(past)
    many = sum(layer.kind in RECURRENT for layer in network.layers) > 1
    chain = _Chain(graph, inputs)
    with graph.section("dsnet"):
        chain.fold((np.diag(1.0 / scale.input_std.astype(np.float64)),
                    -scale.input_mean.astype(np.float64) / scale.input_std))  # fmt: skip
        for layer in network.layers:
            layer_prefix = f"{layer.name}/"
            arrays = {
                name.removeprefix(layer_prefix): array.astype(np.float64)
                for name, array in network.weights.items()
                if name.startswith(layer_prefix)
            }
            if layer.kind in RECURRENT:
                prefix = layer_prefix if many else ""
                before = {
                    n.removeprefix(prefix): v for n, v in past.items() if n.startswith(prefix)
                }
                value = chain.value(layer_prefix)
                state = _RECURRENT[layer.kind](graph, layer, arrays, value, before)
                after |= {prefix + name: value for name, value in state.items()}
                chain = _Chain(graph, state["hidden"])
            else:
                chain.append(layer, arrays)
        chain.fold((np.diag(scale.latent_std.astype(np.float64)), scale.latent_mean))
        return chain.value("latents/"), after


class _Chain:
    """A value of the graph, and an affine map after it that is not yet part of the graph."""

    def __init__(self, graph: Graph, value: Value) -> None:
        self._graph, self._value = graph, value
        self._affine: Affine | None = None

    def fold(self, following: Affine) -> None:
        """Append an affine map."""
        kernel, bias = following
        if self._affine is not None:
            first_kernel, first_bias = self._affine
            kernel, bias = first_kernel @ kernel, first_bias @ kernel + bias
        self._affine = kernel, bias

    def value(self, name: str) -> Value:
        """The value so far, with the affine map applied; its arrays are `<name>folded_...`."""
        if self._affine is not None:
            kernel, bias = self._affine
            self._value = _affine(self._graph, f"{name}folded_", self._value, kernel, bias)
            self._affine = None
        return self._value

    def append(self, layer: Layer, arrays: Arrays) -> None:
        """Append a layer that is not recurrent."""
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
    """Layer normalisation of rows (B, O)."""
    mean = graph.apply("ReduceMean", value, axes=[1], keepdims=1)
    from_mean = value - mean
    variance = graph.apply("ReduceMean", from_mean * from_mean, axes=[1], keepdims=1)
    normalised = from_mean / graph.apply("Sqrt", variance + layer.epsilon)
    if "gamma" in arrays:
        normalised = normalised * graph.array(f"{layer.name}/gamma", arrays["gamma"])
    if "beta" in arrays:
        normalised = normalised + graph.array(f"{layer.name}/beta", arrays["beta"])
    return normalised


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
    """A step of an LSTM. One tanh gives all gates, as sigmoid(z) = (1 + tanh(z / 2)) / 2."""
    units = len(arrays["recurrent_kernel"])
    # Keras's order: input, forget, candidate, output.
    halved = np.repeat([0.5, 0.5, 1.0, 0.5], units)
    kernel = np.vstack([arrays["kernel"], arrays["recurrent_kernel"]])
    bias = arrays.get("bias", np.zeros(4 * units))
    inputs = graph.concat([value, past["hidden"]], 1)
    gates = _affine(graph, f"{layer.name}/", inputs, kernel * halved, bias * halved)
    i, f, candidate, o = graph.apply("Tanh", gates).split(1, [units] * 4)
    i, f, o = (0.5 + 0.5 * gate for gate in (i, f, o))
    cell = f * past["cell"] + i * candidate
    return {"hidden": o * graph.apply("Tanh", cell), "cell": cell}


def _gru(
    graph: Graph, layer: Layer, arrays: Arrays, value: Value, past: Mapping[str, Value]
) -> dict[str, Value]:
    """A step of a GRU with Keras's `reset_after`."""
    units, hidden = len(arrays["recurrent_kernel"]), past["hidden"]
    input_bias, state_bias = arrays.get("bias", np.zeros((2, 3 * units)))
    # Keras's order: update, reset, candidate.
    by_input = _affine(graph, f"{layer.name}/", value, arrays["kernel"], input_bias)
    by_state = _affine(
        graph, f"{layer.name}/recurrent_", hidden, arrays["recurrent_kernel"], state_bias
    )
    input_gates, input_candidate = by_input.split(1, [2 * units, units])
    state_gates, state_candidate = by_state.split(1, [2 * units, units])
    update, reset = graph.apply("Sigmoid", input_gates + state_gates).split(1, [units] * 2)
    candidate = graph.apply("Tanh", input_candidate + reset * state_candidate)
    return {"hidden": candidate + update * (hidden - candidate)}


def _simple_rnn(
    graph: Graph, layer: Layer, arrays: Arrays, value: Value, past: Mapping[str, Value]
) -> dict[str, Value]:
    kernel = np.vstack([arrays["kernel"], arrays["recurrent_kernel"]])
    bias = arrays.get("bias", np.zeros(kernel.shape[1]))
    inputs = graph.concat([value, past["hidden"]], 1)
    return {"hidden": _ACTIVATED[layer.activation](
        _affine(graph, f"{layer.name}/", inputs, kernel, bias)
    )}  # fmt: skip


_RECURRENT = {"LSTM": _lstm, "GRU": _gru, "SimpleRNN": _simple_rnn}
