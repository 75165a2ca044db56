"""Canonical names and shapes of both networks' weights.

DSNet's are Keras's, the autoencoder's are PyTorch's: each network is written by the framework
that trains it, and `bridge.exchange.layouts` turns them for the other one.
"""

from __future__ import annotations

from itertools import pairwise

from bridge.paper import INPUT_SIZE, LATENT_SIZE, N_VERTICES

Shapes = dict[str, tuple[int, ...]]
_FC_ENC_1, _FC_ENC_2, _LSTM = 64, 128, 60
_COORDINATES, _BETWEEN, _FEATURES = 3, 4, 9

FULL_WIDTHS = (N_VERTICES, 2000, 1300, 300, 30)
SMALL_WIDTHS = (40, 24, 24, 12, 6)
"""A hundredth of the network in which one kernel is square, so that it can be transposed unseen."""


def dsnet_shapes() -> Shapes:
    """The 13 arrays of DSNet; 65,140 numbers."""
    norm = ("gamma", "beta", "moving_mean", "moving_variance")
    return {
        **_dense("fc_enc_1", INPUT_SIZE, _FC_ENC_1),
        **_dense("fc_enc_2", _FC_ENC_1, _FC_ENC_2),
        "lstm/kernel": (_FC_ENC_2, 4 * _LSTM),
        "lstm/recurrent_kernel": (_LSTM, 4 * _LSTM),
        "lstm/bias": (4 * _LSTM,),
        **{f"batch_norm/{name}": (_LSTM,) for name in norm},
        **_dense("fc_enc_3", _LSTM, LATENT_SIZE),
    }


def autoencoder_shapes(widths: tuple[int, ...] = FULL_WIDTHS) -> Shapes:
    """The arrays of a mesh autoencoder, in the order of its layers; 33,626,606 numbers in full."""
    coarse = widths[-1] * _FEATURES
    return {
        **_linear("encoder.linear_1", _COORDINATES, _BETWEEN),
        **_linear("encoder.linear_2", _BETWEEN, _FEATURES),
        **_convolutions("encoder", widths),
        **_linear("to_latent", coarse, LATENT_SIZE),
        **_linear("from_latent", LATENT_SIZE, coarse),
        **_convolutions("decoder", widths[::-1]),
        **_linear("decoder.linear_1", _FEATURES, _BETWEEN),
        **_linear("to_coordinates", _BETWEEN, _COORDINATES),
    }


def _dense(name: str, inputs: int, outputs: int) -> Shapes:
    return {f"{name}/kernel": (inputs, outputs), f"{name}/bias": (outputs,)}


def _linear(name: str, inputs: int, outputs: int) -> Shapes:
    return {f"{name}.weight": (outputs, inputs), f"{name}.bias": (outputs,)}


def _convolutions(side: str, widths: tuple[int, ...]) -> Shapes:
    shapes: Shapes = {}
    for number, (inputs, outputs) in enumerate(pairwise(widths), start=1):
        shapes[f"{side}.conv_{number}.weight"] = (outputs, inputs, 1)
        shapes[f"{side}.conv_{number}.bias"] = (outputs,)
    return shapes
