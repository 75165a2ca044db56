"""`casas_otaduy_like`: a network of two frames of its own past and of how the body moves.

Source: Casas and Otaduy, "Learning Nonlinear Soft-Tissue Dynamics for Interactive Avatars",
PACMCGIT 1(1), article 10, 2018. The abstract of patent US 2021/0035347 on the same work names
joint-angle velocities and accelerations and earlier dynamic components as inputs; DSNet's paper
(Sections 2 and 5) says that shape is not among them. That the root's rates are, the hidden layers,
losses and how it is trained were not found: they are ours, as stands in
`CasasOtaduyLike.departures`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.systems.history_noise import HistoryNoise
from benchmarks.systems.kinematics import KINEMATICS_SIZE, changes
from benchmarks.systems.searched import SearchedNetwork
from bridge.exchange.dsnet import Clips
from bridge.exchange.train_options import PredictorSettings
from bridge.paper import LATENT_SIZE, N_BETAS
from tf_dsnet.framework import Tensor, keras, tf
from tf_dsnet.predictors import BodyOf
from tf_dsnet.trainer import LossOf

HIDDEN = 512
"""Units of each of two hidden layers."""
PAST_FRAMES = 2


@dataclass(frozen=True)
class CasasOtaduyLike(SearchedNetwork):
    """An entry of the registry."""

    name: str = "casas_otaduy_like"
    label: str = "Casas-Otaduy-like, network of two past frames"
    masked: bool = True

    def departures(self, settings: PredictorSettings) -> tuple[str, ...]:
        """Choices that are ours."""
        return (
            "138 inputs: the root's rates in its own frame, the joints' in theirs, by backward "
            "differences, each as what it amounts to in 0.1 s; and the latents of two frames",
            f"two hidden layers of {HIDDEN} units, ReLU; one network for all people, told no betas",
            "squared distances of latents; learns single frames from two given ones, to which "
            "noise is added: each latent's own second difference, what going on as before misses",
            "predicts, and is validated, on its own past alone, from the mean offset",
            *super().departures(settings),
        )

    def told(self, joined: NDArray, body: BodyOf) -> NDArray:
        """How the motion changes, (T, 138), of betas and theta (T, 79)."""
        return changes(joined[:, N_BETAS:])

    def examples(self, clips: Clips) -> Clips:
        """With the latents of the two frames before each, (N, T, 138 + 200)."""
        past = [_frames_ago(clips.latents, frames) for frames in range(1, PAST_FRAMES + 1)]
        return replace(clips, inputs=np.concatenate([clips.inputs, *past], axis=-1))

    def build(self, *, input_size: int, masked: bool = False, people: int = 1) -> keras.Model:
        """The network, fresh."""
        return TwoFrameNetwork(self.name)

    def prepare(self, model: keras.Model, clips: Clips) -> None:
        """Measure the noise."""
        model.get_layer("noise").set_spread(np.tile(second_differences(clips), PAST_FRAMES))

    def loss_for(self, clips: Clips) -> LossOf:
        """Squares."""
        return mean_squared_distance


class TwoFrameNetwork(keras.Model):
    """(B, T, 138) to (B, T, 100), on its own past; in training on the given one.

    Then inputs are (B, T, 338): behind the motion's follow the latents of one and two frames ago.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name=name)
        self.noise = HistoryNoise(name="noise")
        self.fc_1 = keras.layers.Dense(HIDDEN, activation="relu", name="fc_1")
        self.fc_2 = keras.layers.Dense(HIDDEN, activation="relu", name="fc_2")
        self.fc_3 = keras.layers.Dense(LATENT_SIZE, name="fc_3")
        past_size = PAST_FRAMES * LATENT_SIZE
        self.noise.build((None, None, past_size))
        self.fc_1.build((None, KINEMATICS_SIZE + past_size))
        self.fc_2.build((None, HIDDEN))
        self.fc_3.build((None, HIDDEN))
        self.built = True

    def call(self, inputs: Tensor, training: bool = False) -> Tensor:
        """Latents (B, T, 100); in [inputs, real frames] the latter make no difference."""
        told = inputs[0] if isinstance(inputs, (list, tuple)) else inputs
        motion = told[..., :KINEMATICS_SIZE]
        if training:
            return self._next(motion, self.noise(told[..., KINEMATICS_SIZE:]))
        return self._roll(motion)

    def _next(self, motion: Tensor, past: Tensor) -> Tensor:
        """Latents (..., 100) of a frame (..., 138) that follows two others (..., 200)."""
        return self.fc_3(self.fc_2(self.fc_1(tf.concat([motion, past], -1))))

    def _roll(self, motion: Tensor) -> Tensor:
        nothing = tf.zeros_like(motion[:, 0, :1]) * tf.zeros((1, LATENT_SIZE), motion.dtype)

        def step(before: tuple[Tensor, Tensor], now: Tensor) -> tuple[Tensor, Tensor]:
            return self._next(now, tf.concat(before, -1)), before[0]

        latents, _ = tf.scan(step, tf.transpose(motion, (1, 0, 2)), (nothing, nothing))
        return tf.transpose(latents, (1, 0, 2))


def mean_squared_distance(target: Tensor, predicted: Tensor, real: Tensor | None) -> Tensor:
    """Mean over real frames (B, T), or all, of the squared distance of latents (B, T, 100)."""
    squared = tf.reduce_sum(tf.square(predicted - target), axis=-1)
    counted = tf.ones_like(squared) if real is None else tf.cast(real, squared.dtype)
    return tf.reduce_sum(counted * squared) / tf.reduce_sum(counted)


def second_differences(clips: Clips) -> NDArray[np.float32]:
    """(100,) root mean squares over real frames of latents less what two frames before foretell."""
    changes = np.diff(clips.latents, n=2, axis=1)[clips.real[:, 2:]]
    size = np.sqrt(np.square(changes, dtype=np.float64).mean(axis=0)) if len(changes) else 0.0
    return np.broadcast_to(size, clips.latents.shape[-1:]).astype(np.float32)


def _frames_ago(latents: NDArray, frames: int) -> NDArray:
    """Latents (N, T, 100) some frames before each; before the first, the mean."""
    found = np.zeros_like(latents)
    found[:, frames:] = latents[:, :-frames]
    return found
