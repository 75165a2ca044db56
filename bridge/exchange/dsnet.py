"""What DSNet is given and gives: codes of offsets, scaling, clips of 300 frames (Section 5), and a
trained network as arrays.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError, unknown_name
from bridge.exchange.layers import DSNET_LAYERS, Layer, layers_from_json
from bridge.exchange.weights import dsnet_shapes, load_weights
from bridge.motion import MotionSequence, sequences_of, shape_rows
from bridge.motion.sequences import Split
from bridge.paper import INPUT_SIZE, LATENT_SIZE, N_BETAS
from bridge.runs import Artifact

LiteralCodeName = Literal["literal", "literal_per_coordinate"]
CodeName = Literal["autoencoder", "literal", "literal_per_coordinate", "pca", "dmpl"]
AUTOENCODER: CodeName = "autoencoder"
"""The mesh autoencoder's latents, trained as the run says."""
LITERAL_CODES: tuple[LiteralCodeName, ...] = ("literal", "literal_per_coordinate")
"""The same network's, trained by the paper's words alone, in both readings of 'within [-1, 1]'."""
PCA: CodeName = "pca"
"""Coefficients in metres of the leading principal components, as many as the latents are; distances
between them are distances between offsets."""
DMPL: CodeName = "dmpl"
"""Coefficients in metres of DMPL's released directions, made orthonormal in their order; only in
runs that were given the licensed file."""
LATENTS_OF: dict[CodeName, str] = {
    AUTOENCODER: "latents",
    **{code: f"latents_{code}" for code in (*LITERAL_CODES, PCA, DMPL)},
}
"""Array of the `encode` artifact that holds a code's latents."""
UNITS: dict[CodeName, str] = {
    **dict.fromkeys((AUTOENCODER, *LITERAL_CODES), "1"),
    **dict.fromkeys((PCA, DMPL), "m"),
}
"""Of a code's latents."""
LINEAR_FILES: dict[CodeName, str] = {PCA: "pca.safetensors", DMPL: "dmpl.safetensors"}
"""Of the `train-ae` artifact: `components` (K, V * 3), `mean_m` (V, 3)."""

_SCALING = "scaling/"
DSNETS = ("dsnet_standardised", "dsnet_faithful")
"""The paper's network as predictors; runs of before layers were recorded hold no others."""
LITERAL_DSNETS: dict[LiteralCodeName, str] = {code: f"dsnet_{code}" for code in LITERAL_CODES}
"""The paper's network on the codes that its words alone give, by code."""


@dataclass(frozen=True, eq=False)
class Scaling:
    """An affine map from a motion's own units to the network's, and back for latents."""

    input_mean: NDArray[np.float32]
    """(I,) subtracted from the inputs: DSNet's 79 of betas and theta, or another network's."""
    input_std: NDArray[np.float32]
    """(I,) then divided by."""
    latent_mean: NDArray[np.float32]
    """(100,) subtracted from latents."""
    latent_std: NDArray[np.float32]
    """(100,) then divided by."""

    @classmethod
    def identity(cls) -> Scaling:
        sizes = (INPUT_SIZE, LATENT_SIZE)
        return cls(*(np.full(size, fill, np.float32) for size in sizes for fill in (0, 1)))

    @classmethod
    def fitted(cls, inputs: NDArray, latents: NDArray, min_input_std: float) -> Scaling:
        """Statistics of the training frames `inputs` (F, I) and `latents` (F, 100).

        Inputs are scaled one by one, for they differ in unit; a spread below `min_input_std`
        (of a joint that hardly turns) is raised to it, so that noise is not magnified. Latents
        share one scale, the root mean square of their spreads: each scaled by its own, dead
        dimensions would count as much as those that move the skin (validation R2 after 160
        epochs on PCA latents of the synthetic corpus: 0.62 with one scale, 0.14 with a hundred).
        """
        inputs, latents = inputs.astype(np.float64), latents.astype(np.float64)
        latent_std = np.sqrt(latents.var(axis=0).mean()) or 1.0
        return cls(
            inputs.mean(axis=0).astype(np.float32),
            np.maximum(inputs.std(axis=0), min_input_std).astype(np.float32),
            latents.mean(axis=0).astype(np.float32),
            np.full(latents.shape[1], latent_std, np.float32),
        )

    def inputs(self, inputs: NDArray) -> NDArray[np.float32]:
        """A motion (..., I) as the network is given it."""
        return ((inputs - self.input_mean) / self.input_std).astype(np.float32)

    def latents(self, latents: NDArray) -> NDArray[np.float32]:
        """Latents (..., 100) as the network learns them."""
        return ((latents - self.latent_mean) / self.latent_std).astype(np.float32)

    def restore(self, outputs: NDArray) -> NDArray[np.float32]:
        """The network's outputs (..., 100) as the autoencoder's latents."""
        return (outputs * self.latent_std + self.latent_mean).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Clips:
    """N sequences of one length T, as the network sees them."""

    inputs: NDArray[np.float32]
    """(N, T, 79) betas, then theta, or what another kind of inputs has; zero where padded."""
    latents: NDArray[np.float32]
    """(N, T, 100); zero where padded."""
    real: NDArray[np.bool_]
    """(N, T) False where padded."""

    def __len__(self) -> int:
        return len(self.inputs)


@dataclass(frozen=True, eq=False)
class UnpaddedClip:
    """One sequence at its own length, in its own units."""

    inputs: NDArray[np.floating]
    """(T, 79) betas, then theta, or what another kind of inputs has."""
    latents: NDArray[np.floating]
    """(T, 100)."""

    @property
    def betas(self) -> NDArray[np.floating]:
        """(10,) of `inputs` that are betas and theta."""
        return self.inputs[0, :N_BETAS]


def join_inputs(theta: NDArray, betas: NDArray) -> NDArray:
    """A motion theta (T, 69) and a shape betas (10,) to the network's inputs (T, 79)."""
    return np.concatenate([np.broadcast_to(betas, (len(theta), len(betas))), theta], axis=1)


def load_unpadded_clips(
    encoded: Artifact, split: Split, code: CodeName = AUTOENCODER
) -> list[UnpaddedClip]:
    """The sequences of one split from the `encode` stage's artifact, with latents of one code."""
    if LATENTS_OF[code] not in encoded.manifest["arrays"]:
        raise DsnetError(
            f"{encoded.path} without latents of {code!r}",
            f"{LATENTS_OF[code]}, on which this predictor is trained",
            f"Run `dsnet train-ae --{code} FILE` and `dsnet encode`, or leave the predictor out.",
        )
    sequences = sequences_of(encoded)
    theta, betas, latents = (encoded.array(name) for name in ("theta", "betas", LATENTS_OF[code]))
    rows = shape_rows(sequences, betas)

    def cut(sequence: MotionSequence) -> UnpaddedClip:
        shape = betas[rows[sequence.name]]
        return UnpaddedClip(join_inputs(theta[sequence.frames], shape), latents[sequence.frames])

    recordings = [cut(sequence) for sequence in sequences if sequence.split == split]
    if not recordings:
        raise DsnetError(
            f"{encoded.path} without a sequence of split {split!r}",
            "at least one sequence to train on and one to validate on",
            "Align more sequences, or name another one for validation.",
        )
    return recordings


def fit_scaling(recordings: list[UnpaddedClip], min_input_std: float) -> Scaling:
    """Mean and spread of every real frame: padding would pull both towards zero."""
    inputs = np.concatenate([recording.inputs for recording in recordings])
    latents = np.concatenate([recording.latents for recording in recordings])
    return Scaling.fitted(inputs, latents, min_input_std)


def make_clips(recordings: list[UnpaddedClip], scaling: Scaling, length: int) -> Clips:
    """Scale, then pad or clip, so that padding is zero to the network whatever the scaling."""
    inputs = _padded([scaling.inputs(recording.inputs) for recording in recordings], length)
    latents = _padded([scaling.latents(recording.latents) for recording in recordings], length)
    frame_counts = np.array([len(recording.inputs) for recording in recordings])
    return Clips(inputs, latents, np.arange(length) < frame_counts[:, None])


def _padded(parts: list[NDArray], length: int) -> NDArray:
    """Sequences (T, D) as (N, length, D): zeros at the end, or the tail cut off.

    Nothing is written where zeros are, and so the system gives no memory for most of them.
    """
    block = np.zeros((len(parts), length, parts[0].shape[1]), parts[0].dtype)
    for row, part in enumerate(parts):
        block[row, : len(part)] = part[:length]
    return block


@dataclass(frozen=True, eq=False)
class TrainedDsnet:
    """One trained network of a run."""

    name: str
    """The predictor's."""
    weights: Mapping[str, NDArray]
    """Named as by `tf_dsnet.model.named_weights`."""
    scaling: Scaling
    layers: tuple[Layer, ...] = DSNET_LAYERS
    """In their order; the arrays of `weights` are theirs."""

    @classmethod
    def from_arrays(
        cls,
        name: str,
        arrays: Mapping[str, NDArray],
        layers: tuple[Layer, ...] = DSNET_LAYERS,
    ) -> TrainedDsnet:
        """The inverse of `arrays`; without `scaling/...`, nothing is scaled."""
        names = [field.name for field in fields(Scaling)]
        weights = {n: array for n, array in arrays.items() if not n.startswith(_SCALING)}
        scaling = Scaling.identity()
        if _SCALING + names[0] in arrays:
            scaling = Scaling(*(arrays[_SCALING + n] for n in names))
        return cls(name, weights, scaling, layers)

    @property
    def is_papers(self) -> bool:
        """Whether layers and widths are the paper's."""
        shapes = {name: array.shape for name, array in self.weights.items()}
        return self.layers == DSNET_LAYERS and shapes == dsnet_shapes()

    def arrays(self) -> dict[str, NDArray]:
        """Weights, and the scaling as `scaling/input_mean` and so on: what a file holds."""
        return {**self.weights, **{_SCALING + n: array for n, array in vars(self.scaling).items()}}


def load_trained_dsnet(train: Artifact, name: str | None = None) -> TrainedDsnet:
    """Read one network from the `train` stage's artifact; the run's default when None."""
    chosen = name or train.manifest["default"]
    check_trained(train, chosen)
    layers = _layers_of(train, chosen)
    if layers is None:
        entry = train.manifest["predictors"][chosen]
        reason = entry.get("no_chain", "which is not DSNet on the autoencoder's latents")
        raise DsnetError(
            f"predictor {chosen!r}, {reason}",
            f"one of {', '.join(dsnets_of(train)) or '(none was trained)'}",
            "Name one of these; `dsnet evaluate` has the errors of the others.",
        )
    weights = load_weights(train.file(f"{chosen}.safetensors"))
    first = next((n for layer in layers if (n := f"{layer.name}/kernel") in weights), "")
    size = len(weights.get(first, ()))
    if size != INPUT_SIZE:
        raise DsnetError(
            f"{chosen}.safetensors of a network of {size} inputs",
            f"{INPUT_SIZE}, betas and theta",
            "Pass weights written by `dsnet train`.",
        )
    return TrainedDsnet.from_arrays(chosen, weights, layers)


def dsnets_of(train: Artifact) -> list[str]:
    """Names of the predictors of a finished `train` that can be stepped from pose to pose: those
    with a list of layers, of the autoencoder's latents. Motions, streams, exports and the viewer
    take these; what else a run has trained has predictions of the run's own sequences.
    """
    return [name for name in train.manifest["predictors"] if _layers_of(train, name)]


def _layers_of(train: Artifact, name: str) -> tuple[Layer, ...] | None:
    """What a predictor is a chain of; None if it is none."""
    entry = train.manifest["predictors"][name]
    if code_of(train, name) != AUTOENCODER or "no_chain" in entry:
        return None
    if "layers" in entry:
        return layers_from_json(entry["layers"])
    return DSNET_LAYERS if name in DSNETS else None


def code_of(train: Artifact, name: str) -> CodeName:
    """Which code's latents a predictor of a finished `train` gives."""
    return train.manifest["predictors"][name].get("code", AUTOENCODER)


def check_trained(train: Artifact, name: str) -> None:
    """Refuse a predictor that a finished `train` does not hold."""
    there = list(train.manifest["predictors"])
    if name not in there:
        command = f"dsnet train --predictors {' '.join(there)} NAME"
        remedy = f"Name one of these, or train it too: {command}."
        raise unknown_name(f"predictor {name!r} of {train.path}", name, there, remedy)
