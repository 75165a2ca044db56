"""SoftSMPL's code of a pose: ten numbers for the rotations of all joints, whoever has the pose.

An encoder 207-500-10 (there with 23 joints; here with the 21 that theta has below the root, 189)
and a decoder that is told the person's shape besides, so that the code need not carry it. The
encoder's sizes are those of the file that the repository of PERGAMO (2022) ships as "the SoftSMPL
encoding"; how it was trained was not found.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.systems.kinematics import POSE_SIZE
from bridge.paper import N_BETAS
from tf_dsnet.framework import Tensor, keras, tf

CODE_SIZE = 10
HIDDEN = 500
ENCODER = ("pose_enc_1", "pose_enc_2")
"""Names of the encoder's layers."""
_LR = 1e-3
_BATCH = 256


def encoder_layers(*, trainable: bool) -> list[keras.layers.Dense]:
    """Deviations (..., 189) to code (..., 10), to be applied one after the other."""
    return [
        keras.layers.Dense(HIDDEN, activation="relu", name=ENCODER[0], trainable=trainable),
        keras.layers.Dense(CODE_SIZE, name=ENCODER[1], trainable=trainable),
    ]


def learn_pose_code(
    deviations: NDArray, betas: NDArray, steps: int
) -> tuple[list[list[NDArray]], list[float]]:
    """Train encoder and decoder on frames (F, 189) of people (F, 10).

    Adam takes `steps` steps of 256 frames, at a rate that falls to 0, by the mean squared error.

    Returns
    -------
    Kernel and bias of each of the encoder's layers, and the loss of each step.
    """
    poses, shapes = (tf.constant(values, tf.float32) for values in (deviations, betas))
    encoder = keras.Sequential([keras.Input((POSE_SIZE,)), *encoder_layers(trainable=True)])
    decoder = keras.Sequential([
        keras.Input((CODE_SIZE + N_BETAS,)),
        keras.layers.Dense(HIDDEN, activation="relu"),
        keras.layers.Dense(POSE_SIZE),
    ])  # fmt: skip
    variables = [*encoder.trainable_variables, *decoder.trainable_variables]
    rate: Any = keras.optimizers.schedules.CosineDecay(_LR, steps)
    optimizer = keras.optimizers.Adam(rate)
    optimizer.build(variables)

    @tf.function
    def step(rows: Tensor) -> Tensor:
        pose, shape = tf.gather(poses, rows), tf.gather(shapes, rows)
        with tf.GradientTape() as tape:
            again = decoder(tf.concat([encoder(pose), shape], -1))
            loss = tf.reduce_mean(tf.square(again - pose))
        optimizer.apply(tape.gradient(loss, variables), variables)
        return loss

    rng = np.random.default_rng(0)
    batches = (rng.integers(len(deviations), size=_BATCH) for _ in range(steps))
    losses = [float(step(tf.constant(rows, tf.int32))) for rows in batches]
    return [layer.get_weights() for layer in encoder.layers], losses


class CodeRates(keras.layers.Layer):
    """A code (B, T, D) with its velocity and acceleration, (B, T, 3 D), standardised.

    Backward differences by the frame; 0 where there is no past yet, as in `kinematics.rates`.
    """

    def build(self, input_shape: Any) -> None:
        """Means are 0 and spreads 1 until they are set."""
        size = (3 * input_shape[-1],)
        self.mean = self.add_weight(name="mean", shape=size, initializer="zeros", trainable=False)
        self.spread = self.add_weight(name="spread", shape=size, initializer="ones",
                                      trainable=False)  # fmt: skip
        self.built = True

    def call(self, code: Tensor) -> Tensor:
        """(B, T, 3 D)."""
        velocity = code - tf.concat([code[:, :1], code[:, :-1]], 1)
        # The second frame's velocity is also taken for that before it, which makes 0 of its rate.
        before = tf.concat([velocity[:, :1], velocity[:, 1:2], velocity[:, 1:-1]], 1)
        told = tf.concat([code, velocity, velocity - before], -1)
        return (told - self.mean) / self.spread

    def standardise(self, told: NDArray) -> None:
        """Set means and spreads to those of rates (F, 3 D) that this layer gave, unset."""
        spread = told.std(axis=0)
        self.mean.assign(told.mean(axis=0))
        self.spread.assign(np.where(spread > 0, spread, 1.0))
