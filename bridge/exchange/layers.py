"""A network's layers as plain words: what a file says of it, beside its arrays.

A chain, each layer of the one before. Names of kinds and activations are Keras's; a layer's
arrays are `<name>/<array>`, and its width is theirs.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from bridge.errors import DsnetError
from bridge.exchange.weights import BATCH_NORM_EPSILON

ACTIVATIONS = ("linear", "tanh", "relu", "sigmoid", "elu", "gelu")
RECURRENT = ("LSTM", "GRU", "SimpleRNN")
KINDS = (
    "Dense", *RECURRENT, "BatchNormalization", "LayerNormalization", "Dropout", "Activation",
)  # fmt: skip


@dataclass(frozen=True)
class Layer:
    """One layer of a chain."""

    kind: str
    """One of `KINDS`. The gates of LSTM and GRU are sigmoids, a GRU resets after its product."""
    name: str
    activation: str = "linear"
    """One of `ACTIVATIONS`; `tanh` of LSTM and GRU."""
    epsilon: float = 0.0
    """Added to the variance by normalisations."""


DSNET_LAYERS = (
    Layer("Dense", "fc_enc_1"),
    Layer("Dense", "fc_enc_2", "tanh"),
    Layer("LSTM", "lstm", "tanh"),
    Layer("BatchNormalization", "batch_norm", epsilon=BATCH_NORM_EPSILON),
    Layer("Dense", "fc_enc_3"),
)
"""Of the paper's network (Figure 5)."""


def layers_as_json(layers: Iterable[Layer]) -> list[dict[str, Any]]:
    """As a manifest holds them."""
    return [asdict(layer) for layer in layers]


def layers_from_json(entries: Sequence[Mapping[str, Any]]) -> tuple[Layer, ...]:
    """The inverse of `layers_as_json`; DsnetError if an entry is no layer."""
    layers = []
    for entry in entries:
        try:
            layer = Layer(**entry)
            known = layer.kind in KINDS and layer.activation in ACTIVATIONS
            known = known and isinstance(layer.name, str) and 0 <= layer.epsilon < 1
        except TypeError:
            known = False
        if not known:
            raise DsnetError(
                f"{entry!r:.200} as a layer",
                f"a kind of {', '.join(KINDS)} with an activation of {', '.join(ACTIVATIONS)}",
                "Train the network again by `dsnet train`.",
            )
        layers.append(layer)
    return tuple(layers)
