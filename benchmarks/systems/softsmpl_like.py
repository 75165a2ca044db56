"""`softsmpl_like`: a recurrent network told a compact pose, the root's rates and the shape.

Source: Santesteban, Garces, Otaduy and Casas, "SoftSMPL: Data-driven Modeling of Nonlinear
Soft-tissue Dynamics for Parametric Humans", Eurographics 2020 (abstract and introduction: shape and
a motion descriptor; a deshaped static pose; a GRU; an autoencoder of offsets). The descriptor's 42
numbers are those of the first author's later code (vto-garment-collisions, `src/model.py`), which
SoftSMPL is only thought to share; the pose code is as `pose_code` says. The GRU's width, the loss
and its weights were not found. The transfer of motions between people, by which its training data
were enlarged, is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.systems.kinematics import POSE_SIZE, deviations_from_rest, root_rates
from benchmarks.systems.pose_code import (
    CODE_SIZE,
    ENCODER,
    CodeRates,
    encoder_layers,
    learn_pose_code,
)
from benchmarks.systems.searched import SearchedNetwork
from bridge.exchange.dsnet import Clips, Scaling, UnpaddedClip
from bridge.exchange.train_options import PredictorSettings
from bridge.paper import LATENT_SIZE, N_BETAS
from tf_dsnet.framework import Tensor, keras, tf
from tf_dsnet.predictors import BodyOf
from tf_dsnet.trainer import LossOf

UNITS = 256
"""Of the GRU."""


@dataclass(frozen=True)
class SoftSmplLike(SearchedNetwork):
    """An entry of the registry."""

    name: str = "softsmpl_like"
    label: str = "SoftSMPL-like, recurrent network on a pose code"
    masked: bool = True
    pose_steps: int = 3000
    """Steps of the pose code's training, which comes first and is not counted as epochs."""

    def departures(self, settings: PredictorSettings) -> tuple[str, ...]:
        """Choices that are ours."""
        return (
            f"pose code of {CODE_SIZE} numbers from the 21 joints that theta has, learned first, "
            "on R - I as it is, with a decoder that is told betas",
            f"one GRU of {UNITS} units and a linear layer",
            "absolute errors of latents, of their velocity and of their acceleration, each by the "
            "training frames' mean size; vertices enter through distances of latents",
            "no transfer of motions between people",
            *super().departures(settings),
        )

    def told(self, joined: NDArray, body: BodyOf) -> NDArray:
        """R - I, the root's rates and betas, (T, 189 + 12 + 10), of betas and theta (T, 79)."""
        betas, theta = joined[:, :N_BETAS], joined[:, N_BETAS:]
        return np.concatenate([deviations_from_rest(theta), root_rates(theta), betas], axis=1)

    def scaling(self, train: list[UnpaddedClip], settings: PredictorSettings) -> Scaling:
        """R - I is left as it is: its entries have one unit and one range."""
        fitted = super().scaling(train, settings)
        mean, std = fitted.input_mean.copy(), fitted.input_std.copy()
        mean[:POSE_SIZE], std[:POSE_SIZE] = 0.0, 1.0
        return replace(fitted, input_mean=mean, input_std=std)

    def build(self, *, input_size: int, masked: bool = False, people: int = 1) -> keras.Model:
        """The network, fresh; it needs no mask, for padding stands at the end."""
        motion: Tensor = keras.Input((None, input_size), name="motion")
        real = keras.Input((None,), dtype="bool", name="real_frames")
        code: Tensor = motion[..., :POSE_SIZE]
        for layer in encoder_layers(trainable=False):
            code = layer(code)
        described = CodeRates(name="code_rates")(code)
        join = keras.layers.Concatenate(name="descriptor_and_betas")
        told = join([described, motion[..., POSE_SIZE:]])  # (B, T, 52)
        memory = keras.layers.GRU(UNITS, return_sequences=True, name="gru")(told)
        latents = keras.layers.Dense(LATENT_SIZE, name="fc")(memory)
        return keras.Model([motion, real] if masked else motion, latents, name=self.name)

    def prepare(self, model: keras.Model, clips: Clips) -> None:
        """Learn the pose code, and the spread of its rates."""
        frames = clips.inputs[clips.real]
        deviations, betas = frames[:, :POSE_SIZE], frames[:, -N_BETAS:]
        weights, _ = learn_pose_code(deviations, betas, self.pose_steps)
        for name, arrays in zip(ENCODER, weights, strict=True):
            model.get_layer(name).set_weights(arrays)
        rates = model.get_layer("code_rates")
        told = [
            rates(_coded(model, inputs[:, :POSE_SIZE])).numpy()[0][real]
            for inputs, real in zip(clips.inputs, clips.real, strict=True)
        ]
        rates.standardise(np.concatenate(told))

    def loss_for(self, clips: Clips) -> LossOf:
        """Position, velocity and acceleration, of like weight."""
        return DynamicLoss(mean_sizes(clips))


class DynamicLoss:
    """Mean absolute errors of latents and of their first two differences, each by a size.

    Coefficients of principal components are coordinates of offsets in an orthonormal basis, so
    Euclidean distances between latents are those between offsets, all vertices together, and hold
    for velocities and accelerations too. Sums of absolute values are not kept by a change of
    basis: these are SoftSMPL's in kind only.
    """

    def __init__(self, sizes: Sequence[float]) -> None:
        self._sizes = sizes

    def __call__(self, target: Tensor, predicted: Tensor, real: Tensor | None) -> Tensor:
        """A number, of latents (B, T, D) and which frames are real (B, T)."""
        missed = predicted - target
        counted = tf.ones_like(missed[..., 0]) if real is None else tf.cast(real, missed.dtype)
        total = 0.0
        for size in self._sizes:
            apart = tf.reduce_mean(tf.abs(missed), axis=-1)
            total += tf.reduce_sum(counted * apart) / (size * tf.reduce_sum(counted))
            missed, counted = missed[:, 1:] - missed[:, :-1], counted[:, 1:]
        return total


def mean_sizes(clips: Clips) -> list[float]:
    """Mean absolute latent, velocity and acceleration by the frame, of real frames; never 0."""
    sizes = []
    for order in range(3):
        changes = np.diff(clips.latents, n=order, axis=1)[clips.real[:, order:]]
        sizes.append(
            float(np.abs(changes, dtype=np.float64).mean() if changes.size else 0.0) or 1.0
        )
    return sizes


def _coded(model: keras.Model, deviations: NDArray) -> Tensor:
    """The code (1, T, 10) of deviations (T, 189)."""
    first, second = (model.get_layer(name) for name in ENCODER)
    return second(first(tf.constant(deviations[None])))
