"""Sequences as blocks of 300 frames, padded with zeros or clipped (Section 5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.exchange.codes import AUTOENCODER, LATENTS_OF, CodeName
from bridge.exchange.trained_dsnet import Scaling
from bridge.motion import MotionSequence, sequences_of, subject_rows
from bridge.motion.sequences import Split
from bridge.paper import N_BETAS
from bridge.runs import Artifact


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
    """The sequences of one split from the `encode` stage's artifact, with latents of one code.

    Raises
    ------
    DsnetError
        If there are none, or the run does not have this code.
    """
    if LATENTS_OF[code] not in encoded.manifest["arrays"]:
        raise DsnetError(
            f"{encoded.path} without latents of {code!r}",
            f"{LATENTS_OF[code]}, on which this predictor is trained",
            f"Run `dsnet train-ae --{code} FILE` and `dsnet encode`, or leave the predictor out.",
        )
    sequences = sequences_of(encoded)
    rows = subject_rows(sequences)
    theta, betas, latents = (encoded.array(name) for name in ("theta", "betas", LATENTS_OF[code]))

    def cut(sequence: MotionSequence) -> UnpaddedClip:
        shape = betas[rows[sequence.subject]]
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
