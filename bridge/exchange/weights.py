"""Weights: named arrays in files and checkpoints, and what one layer is in either framework.

Files, and every comparison, hold weights in the layout of the framework that trains the network:
DSNet's in Keras's (`fc_enc_1/kernel`, (in, out)), the autoencoder's in PyTorch's
(`encoder.linear_1.weight`, (out, in)). Whoever is on the other side of the bridge converts here.

==================== ================================= =======================================
layer                Keras                             PyTorch
==================== ================================= =======================================
linear               `kernel` (in, out)                `weight` (out, in)
convolution          `kernel` (in, out), a linear      `weight` (out, in, 1)
                     layer over vertices
LSTM                 `kernel`, `recurrent_kernel`      `weight_ih_l0`, `weight_hh_l0`
                     (in, 4 units), one `bias`;        (4 units, in), two biases that are
                     gates i, f, c, o                  added; gates i, f, g, o: the same order
batch normalisation  `gamma`, `beta`, `moving_mean`,   `weight`, `bias`, `running_mean`,
                     `moving_variance`                 `running_var`
==================== ================================= =======================================

Nothing is computed but moved, so a round trip gives every bit back.

The frameworks' defaults differ too: a twin in the other framework takes the constants below, of the
one that trains the network, in place of its own.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import load_file, save_file

from bridge.errors import DsnetError, notify
from bridge.paper import DSNET_WIDTHS, FEATURES, INFERRED_WIDTHS, INPUT_SIZE, LATENT_SIZE
from bridge.runs import Artifact
from bridge.runs.files import arrays_sha256, written_whole
from bridge.runs.untrusted import damage_refused, is_of_the_machine, open_regular

_MOST_HEADER_BYTES = 1 << 20
_DIGEST = "sha256"
Shapes = dict[str, tuple[int, ...]]

BATCH_NORM_EPSILON = 1e-3
"""Added to the variance under the root; PyTorch's default is 1e-5."""
BATCH_NORM_MOMENTUM = 0.99
"""moving = momentum * moving + (1 - momentum) * batch; PyTorch calls 1 - momentum momentum."""
MASKED_COUNT_EPSILON = 1e-7
"""Keras divides masked sums by count + this, in the mean and in the variance."""


@dataclass(frozen=True)
class AdamRule:
    """Adam as one framework computes it; t counts steps from 1.

    epsilon_hat:     w -= lr sqrt(1 - b2^t) / (1 - b1^t) * m / (sqrt(v) + epsilon)
    not epsilon_hat: w -= lr / (1 - b1^t) * m / (sqrt(v / (1 - b2^t)) + epsilon)
    """

    learning_rate: float = 1e-4
    """The paper's, for both networks (Section 5)."""
    beta_1: float = 0.9
    beta_2: float = 0.999
    epsilon: float = 1e-7
    epsilon_hat: bool = True
    """Whether epsilon stands beside the second moment before its bias correction."""


KERAS_ADAM = AdamRule()
"""`keras.optimizers.Adam`, with which DSNet is trained."""
TORCH_ADAM = AdamRule(epsilon=1e-8, epsilon_hat=False)
"""`torch.optim.Adam`, with which the autoencoder is trained."""

_DENSE = {"kernel": "weight", "bias": "bias"}
_LSTM = {"kernel": "weight_ih_l0", "recurrent_kernel": "weight_hh_l0", "bias": "bias_ih_l0"}
_BATCH_NORM = {"gamma": "weight", "beta": "bias", "moving_mean": "running_mean",
               "moving_variance": "running_var"}  # fmt: skip
DSNET_TORCH_NAMES = {
    f"{layer}/{ours}": f"{layer}.{theirs}"
    for layer, variables in {
        "fc_enc_1": _DENSE, "fc_enc_2": _DENSE, "lstm": _LSTM, "batch_norm": _BATCH_NORM,
        "fc_enc_3": _DENSE,
    }.items()
    for ours, theirs in variables.items()
}  # fmt: skip
"""PyTorch's name of each of DSNet's arrays, by Keras's."""
TORCH_SECOND_BIAS = "lstm.bias_hh_l0"
"""PyTorch's LSTM adds a second bias, which Keras has no counterpart of: the twin keeps it at 0."""
_KERAS_VARIABLES = {"weight": "kernel", "bias": "bias"}


def save_weights(path: Path | str, weights: Mapping[str, NDArray], **metadata: str) -> None:
    """Write named arrays atomically into a safetensors file; `metadata` holds strings only."""
    arrays = {name: np.require(array, requirements="C") for name, array in weights.items()}
    with written_whole(Path(path), alone=True) as partial:
        try:
            save_file(arrays, partial, metadata=metadata)
        except SafetensorError as error:
            # Of the system's own refusal, such as a full disk, the library gives the text.
            if not (refused := re.search(r"os error (\d+)", str(error))):
                raise
            number = int(refused[1])
            raise OSError(number, os.strerror(number), str(partial)) from error


def load_weights(path: Path | str) -> dict[str, NDArray]:
    """Read named arrays of numbers; files that are missing, damaged or others are refused."""

    def refusal(error: Exception) -> DsnetError:
        return DsnetError(
            f"{path}, which does not load ({str(error)[:200]})",
            "a safetensors file written by dsnet",
            "Train again, or copy the file again.",
        )

    with damage_refused(refusal, SafetensorError):
        with open_regular(path) as stream:
            header_bytes = int.from_bytes(stream.read(8), "little")
        if header_bytes > _MOST_HEADER_BYTES:
            raise ValueError(f"a header of {header_bytes} bytes")
        weights = load_file(path)
        for name, array in weights.items():
            if array.dtype.kind not in "iufb" or not name.isprintable():
                raise ValueError(f"{name!r} of {array.dtype}")
    return weights


def refuse_nonfinite(weights: Mapping[str, NDArray], owner: str, remedy: str) -> None:
    """Refuse trained weights with NaN or infinity; `owner` says whose, `remedy` what to do."""
    for name, array in weights.items():
        if not np.isfinite(array).all():
            raise DsnetError(f"weights {name!r} of {owner} with NaN or inf", "numbers", remedy)


def check_shapes(weights: Mapping[str, NDArray], wanted: Shapes, whose: str, remedy: str) -> None:
    """Refuse weights of which a name or a shape differs from those `wanted`, which are `whose`."""
    given = {name: array.shape for name, array in weights.items()}
    if differing := sorted({name for name, _ in wanted.items() ^ given.items()}):
        first = next(iter(wanted))
        raise DsnetError(
            f"weights that differ from {whose} in {', '.join(differing)}",
            f"{len(wanted)} arrays such as {first} {wanted[first]}",
            remedy,
        )


def save_checkpoint(path: Path, arrays: dict[str, NDArray]) -> None:
    """Write named arrays that a training goes on from, and their digest, atomically."""
    save_weights(path, arrays, **{_DIGEST: arrays_sha256(arrays)})


def load_checkpoint(path: Path) -> dict[str, NDArray] | None:
    """The arrays as they were written, None if there are none.

    A damaged one is none, with a line: what it held is made again, with the same result.
    """
    if not path.is_file():
        return None
    try:
        # Which says, where it cannot, why.
        with open_regular(path), safe_open(path, framework="numpy") as file:
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
            written = (file.metadata() or {}).get(_DIGEST)
    except (OSError, SafetensorError) as error:
        if is_of_the_machine(error):
            raise
        arrays, written = {}, None
    if written != arrays_sha256(arrays):
        notify(f"{path} is damaged; what it held is made again")
        return None
    return arrays


def load_autoencoder(codec: Artifact) -> tuple[dict[str, NDArray], dict[str, Any]]:
    """Weights of a finished `train-ae`, named as by PyTorch, with those of its normaliser, and its
    architecture."""
    arrays = load_weights(codec.file("autoencoder.safetensors"))
    weights = {name.removeprefix("model."): array for name, array in arrays.items()}
    return weights, codec.manifest["architecture"]


def dsnet_to_torch(weights: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """DSNet's weights, or some of them, as its PyTorch twin's, with a second LSTM bias of 0."""
    state = {_named(name, DSNET_TORCH_NAMES): _reversed(array) for name, array in weights.items()}
    if "lstm/bias" in weights:
        state[TORCH_SECOND_BIAS] = np.zeros_like(weights["lstm/bias"])
    return state


def dsnet_from_torch(state: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """The inverse of `dsnet_to_torch`; a second LSTM bias that is not 0 is added to the first."""
    ours = {theirs: ours for ours, theirs in DSNET_TORCH_NAMES.items()}
    second = state.get(TORCH_SECOND_BIAS, np.zeros(1))
    weights = {
        _named(name, ours): _reversed(array)
        for name, array in state.items()
        if name != TORCH_SECOND_BIAS
    }
    if np.any(second):  # adding 0 would turn -0.0 into 0.0
        weights["lstm/bias"] += second
    return weights


def mesh_autoencoder_to_keras(weights: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """The autoencoder's weights, named and laid out as by PyTorch, as its Keras twin's."""
    converted = {}
    for name, array in weights.items():
        layer, _, variable = name.rpartition(".")
        if array.ndim == 3:  # a convolution's, of kernel size 1
            array = array[..., 0]
        converted[f"{layer}/{_named(variable, _KERAS_VARIABLES)}"] = _reversed(array)
    return converted


def mesh_autoencoder_from_keras(weights: Mapping[str, NDArray]) -> dict[str, NDArray]:
    variables = {keras: torch for torch, keras in _KERAS_VARIABLES.items()}
    converted = {}
    for name, array in weights.items():
        layer, _, variable = name.rpartition("/")
        array = _reversed(array)
        if ".conv_" in name and array.ndim == 2:
            array = array[..., np.newaxis]
        converted[f"{layer}.{_named(variable, variables)}"] = array
    return converted


def dsnet_shapes() -> Shapes:
    """The 13 arrays of DSNet; 65,140 numbers."""
    dense_1, dense_2, lstm, out = DSNET_WIDTHS.values()
    norm = ("gamma", "beta", "moving_mean", "moving_variance")
    return {
        "fc_enc_1/kernel": (INPUT_SIZE, dense_1),
        "fc_enc_1/bias": (dense_1,),
        "fc_enc_2/kernel": (dense_1, dense_2),
        "fc_enc_2/bias": (dense_2,),
        "lstm/kernel": (dense_2, 4 * lstm),
        "lstm/recurrent_kernel": (lstm, 4 * lstm),
        "lstm/bias": (4 * lstm,),
        **{f"batch_norm/{name}": (lstm,) for name in norm},
        "fc_enc_3/kernel": (lstm, out),
        "fc_enc_3/bias": (out,),
    }


def autoencoder_shapes(widths: tuple[int, ...] = INFERRED_WIDTHS) -> Shapes:
    """The arrays of a mesh autoencoder, in the order of its layers; 33,626,606 numbers in full."""
    coordinates, between, features = FEATURES
    coarse = widths[-1] * features
    steps = range(1, len(widths))
    layers: Shapes = {
        "encoder.linear_1": (between, coordinates),
        "encoder.linear_2": (features, between),
        **{f"encoder.conv_{step}": (widths[step], widths[step - 1], 1) for step in steps},
        "to_latent": (LATENT_SIZE, coarse),
        "from_latent": (coarse, LATENT_SIZE),
        **{f"decoder.conv_{step}": (widths[-step - 1], widths[-step], 1) for step in steps},
        "decoder.linear_1": (between, features),
        "to_coordinates": (coordinates, between),
    }
    shapes: Shapes = {}
    for layer, shape in layers.items():
        shapes |= {f"{layer}.weight": shape, f"{layer}.bias": shape[:1]}
    return shapes


def _reversed(array: NDArray) -> NDArray:
    """A copy with the axes in reverse order: (in, out) to (out, in) and back."""
    return np.array(array.T, order="C")


def _named(name: str, names: Mapping[str, str]) -> str:
    if name not in names:
        raise DsnetError(
            f"weights named {name!r}",
            f"one of {', '.join(names)}",
            "Pass the weights of the network that is built, and nothing else.",
        )
    return names[name]
