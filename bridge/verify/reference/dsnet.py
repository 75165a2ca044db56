"""DSNet (Section 5, Figure 5): forwards for a clip or a frame, and backwards."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bridge.exchange.weights import BATCH_NORM_EPSILON, BATCH_NORM_MOMENTUM, MASKED_COUNT_EPSILON
from bridge.verify.reference import layers
from bridge.verify.reference.adam import Arrays, Pass
from bridge.verify.reference.losses import sum_of_distances

LAYERS = ("fc_enc_1", "fc_enc_2", "lstm", "batch_norm", "fc_enc_3")


@dataclass(frozen=True)
class Batch:
    """Clips to learn from."""

    motion: np.ndarray
    """(B, T, 79) inputs."""
    latents: np.ndarray
    """(B, T, 100) what to predict."""
    real: np.ndarray | None
    """(B, T) frames that count in the loss and in the statistics; all when None."""


def predict(weights: Arrays, motion: np.ndarray) -> Arrays:
    """Every layer's output for whole clips (B, T, 79), with the running statistics."""
    outputs, _steps = _up_to_lstm(weights, motion)
    return _from_lstm(weights, outputs, *_running(weights))


def predict_by_frames(weights: Arrays, motion: np.ndarray) -> Arrays:
    """The same one frame at a time: nothing but hidden and cell state pass from one to the next."""
    hidden = cell = np.zeros((len(motion), len(weights["lstm/recurrent_kernel"])))
    frames = []
    for frame in motion.swapaxes(0, 1):
        outputs = _dense_layers(weights, frame)
        step = layers.lstm_step(outputs["fc_enc_2"], hidden, cell, *_lstm_weights(weights))
        hidden, cell = step.hidden, step.cell
        outputs["lstm"] = hidden
        frames.append(_from_lstm(weights, outputs, *_running(weights)))
    return {name: np.stack([frame[name] for frame in frames], axis=1) for name in LAYERS}


def predict_in_training(weights: Arrays, batch: Batch) -> Arrays:
    """Every layer's output with the statistics of the batch itself."""
    outputs, _steps = _up_to_lstm(weights, batch.motion)
    batch_moments = layers.moments(outputs["lstm"], batch.real, MASKED_COUNT_EPSILON)
    return _from_lstm(weights, outputs, batch_moments.mean, batch_moments.variance)


def learn(weights: Arrays, batch: Batch) -> Pass:
    """Loss, gradients of all trainable parameters, and the running statistics moved on."""
    w = weights
    outputs, steps = _up_to_lstm(w, batch.motion)
    batch_moments = layers.moments(outputs["lstm"], batch.real, MASKED_COUNT_EPSILON)
    outputs = _from_lstm(w, outputs, batch_moments.mean, batch_moments.variance)
    loss, dy = sum_of_distances(batch.latents, outputs["fc_enc_3"], batch.real)

    g: Arrays = {}
    dy, g["fc_enc_3/kernel"], g["fc_enc_3/bias"] = layers.dense_backward(
        dy, outputs["batch_norm"], w["fc_enc_3/kernel"]
    )
    dy, g["batch_norm/gamma"], g["batch_norm/beta"] = layers.batch_norm_backward(
        dy, outputs["lstm"], batch_moments, w["batch_norm/gamma"], BATCH_NORM_EPSILON
    )
    dy, g["lstm/kernel"], g["lstm/recurrent_kernel"], g["lstm/bias"] = layers.lstm_backward(
        dy, outputs["fc_enc_2"], steps, w["lstm/kernel"], w["lstm/recurrent_kernel"]
    )
    dy = dy * (1 - outputs["fc_enc_2"] ** 2)
    dy, g["fc_enc_2/kernel"], g["fc_enc_2/bias"] = layers.dense_backward(
        dy, outputs["fc_enc_1"], w["fc_enc_2/kernel"]
    )
    _, g["fc_enc_1/kernel"], g["fc_enc_1/bias"] = layers.dense_backward(
        dy, batch.motion, w["fc_enc_1/kernel"]
    )
    return Pass(loss, g, _moved_on(w, batch_moments))


def _dense_layers(w: Arrays, motion: np.ndarray) -> Arrays:
    first = layers.dense(motion, w["fc_enc_1/kernel"], w["fc_enc_1/bias"])
    second = np.tanh(layers.dense(first, w["fc_enc_2/kernel"], w["fc_enc_2/bias"]))
    return {"fc_enc_1": first, "fc_enc_2": second}


def _up_to_lstm(w: Arrays, motion: np.ndarray) -> tuple[Arrays, list[layers.LstmStep]]:
    outputs = _dense_layers(w, motion)
    steps = layers.lstm(outputs["fc_enc_2"], *_lstm_weights(w))
    return {**outputs, "lstm": np.stack([step.hidden for step in steps], axis=1)}, steps


def _from_lstm(w: Arrays, outputs: Arrays, mean: np.ndarray, variance: np.ndarray) -> Arrays:
    normalised = layers.batch_norm(
        outputs["lstm"],
        mean,
        variance,
        w["batch_norm/gamma"],
        w["batch_norm/beta"],
        BATCH_NORM_EPSILON,
    )
    latents = layers.dense(normalised, w["fc_enc_3/kernel"], w["fc_enc_3/bias"])
    return {**outputs, "batch_norm": normalised, "fc_enc_3": latents}


def _lstm_weights(w: Arrays) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return w["lstm/kernel"], w["lstm/recurrent_kernel"], w["lstm/bias"]


def _running(w: Arrays) -> tuple[np.ndarray, np.ndarray]:
    return w["batch_norm/moving_mean"], w["batch_norm/moving_variance"]


def _moved_on(w: Arrays, batch: layers.Moments) -> Arrays:
    seen = {"batch_norm/moving_mean": batch.mean, "batch_norm/moving_variance": batch.variance}
    keep = BATCH_NORM_MOMENTUM
    return {name: keep * w[name] + (1 - keep) * new for name, new in seen.items()}
