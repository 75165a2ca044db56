"""DSNet (Section 5, Figure 5), forwards and backwards; and Adam."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from bridge.exchange.engine import Tensors, prefixed, trained
from bridge.exchange.weights import (
    BATCH_NORM_EPSILON,
    BATCH_NORM_MOMENTUM,
    KERAS_ADAM,
    MASKED_COUNT_EPSILON,
    AdamRule,
)
from dsnet.verify.reference import layers
from dsnet.verify.reference.layers import Arrays


class Pass(NamedTuple):
    loss: float
    gradients: Arrays
    """By trainable parameter."""
    statistics: Arrays
    """Weights that the pass itself moves on: the running statistics."""
    outputs: Arrays
    """Of every layer."""


def predict(w: Arrays, motion: np.ndarray) -> Arrays:
    """Every layer's output for whole clips (B, T, 79), with the running statistics."""
    outputs, _steps = _up_to_lstm(w, motion)
    return _from_lstm(w, outputs, w["batch_norm/moving_mean"], w["batch_norm/moving_variance"])


def predict_latents(w: Arrays, motion: np.ndarray) -> np.ndarray:
    """(B, T, 100) of motions (B, T, 79) in their own units, by `scaling/...` among the weights."""
    if "scaling/input_mean" in w:
        motion = (motion - w["scaling/input_mean"]) / w["scaling/input_std"]
    latents = predict(w, motion)["fc_enc_3"]
    if "scaling/latent_mean" in w:
        latents = latents * w["scaling/latent_std"] + w["scaling/latent_mean"]
    return latents


def learn(
    w: Arrays, motion: np.ndarray, latents: np.ndarray, real: np.ndarray | None = None
) -> Pass:
    """Loss and gradients of a batch whose own statistics normalise it.

    Of motions (B, T, 79) and latents (B, T, 100); all frames count unless `real` (B, T) is given.
    """
    outputs, steps = _up_to_lstm(w, motion)
    batch = layers.moments(outputs["lstm"], real, MASKED_COUNT_EPSILON)
    outputs = _from_lstm(w, outputs, batch.mean, batch.variance)
    loss, dy = layers.sum_of_distances(latents, outputs["fc_enc_3"], real)

    g: Arrays = {}
    dy, g["fc_enc_3/kernel"], g["fc_enc_3/bias"] = layers.dense_backward(
        dy, outputs["batch_norm"], w["fc_enc_3/kernel"]
    )
    dy, g["batch_norm/gamma"], g["batch_norm/beta"] = layers.batch_norm_backward(
        dy, outputs["lstm"], batch, w["batch_norm/gamma"], BATCH_NORM_EPSILON
    )
    dy, g["lstm/kernel"], g["lstm/recurrent_kernel"], g["lstm/bias"] = layers.lstm_backward(
        dy, outputs["fc_enc_2"], steps, w["lstm/kernel"], w["lstm/recurrent_kernel"]
    )
    dy, g["fc_enc_2/kernel"], g["fc_enc_2/bias"] = layers.dense_backward(
        dy * (1 - outputs["fc_enc_2"] ** 2), outputs["fc_enc_1"], w["fc_enc_2/kernel"]
    )
    _, g["fc_enc_1/kernel"], g["fc_enc_1/bias"] = layers.dense_backward(
        dy, motion, w["fc_enc_1/kernel"]
    )
    seen = {"batch_norm/moving_mean": batch.mean, "batch_norm/moving_variance": batch.variance}
    keep = BATCH_NORM_MOMENTUM
    moved_on = {name: keep * w[name] + (1 - keep) * new for name, new in seen.items()}
    return Pass(loss, g, moved_on, outputs)


def _up_to_lstm(w: Arrays, motion: np.ndarray) -> tuple[Arrays, list[layers.LstmStep]]:
    first = layers.dense(motion, w["fc_enc_1/kernel"], w["fc_enc_1/bias"])
    second = np.tanh(layers.dense(first, w["fc_enc_2/kernel"], w["fc_enc_2/bias"]))
    steps = layers.lstm(second, w["lstm/kernel"], w["lstm/recurrent_kernel"], w["lstm/bias"])
    hidden = np.stack([step.hidden for step in steps], axis=1)
    return {"fc_enc_1": first, "fc_enc_2": second, "lstm": hidden}, steps


def _from_lstm(w: Arrays, outputs: Arrays, mean: np.ndarray, variance: np.ndarray) -> Arrays:
    gamma, beta = w["batch_norm/gamma"], w["batch_norm/beta"]
    normalised = layers.batch_norm(outputs["lstm"], mean, variance, gamma, beta, BATCH_NORM_EPSILON)
    latents = layers.dense(normalised, w["fc_enc_3/kernel"], w["fc_enc_3/bias"])
    return {**outputs, "batch_norm": normalised, "fc_enc_3": latents}


def adam_step(
    rule: AdamRule, t: int, weights: Arrays, gradients: Arrays, first: Arrays, second: Arrays
) -> tuple[Arrays, Arrays, Arrays]:
    """New weights and moments after step t = 1, 2, ... for every name in `gradients`."""
    new_weights, new_first, new_second = {}, {}, {}
    for name, gradient in gradients.items():
        m = rule.beta_1 * first[name] + (1 - rule.beta_1) * gradient
        v = rule.beta_2 * second[name] + (1 - rule.beta_2) * gradient**2
        first_share, second_share = 1 - rule.beta_1**t, 1 - rule.beta_2**t
        if rule.epsilon_hat:
            change = m * np.sqrt(second_share) / (np.sqrt(v) + rule.epsilon)
        else:
            change = m / (np.sqrt(v / second_share) + rule.epsilon)
        new_weights[name] = weights[name] - rule.learning_rate / first_share * change
        new_first[name], new_second[name] = m, v
    return new_weights, new_first, new_second


def train(
    weights: Arrays, run_pass: Callable[[Arrays], Pass], rule: AdamRule, steps: Sequence[int]
) -> Tensors:
    first = now = run_pass(weights)
    m = v = {name: np.zeros_like(gradient) for name, gradient in first.gradients.items()}
    t, w = 0, weights

    def step() -> float:
        nonlocal now, m, v, t, w
        t, before = t + 1, now.loss
        stepped, m, v = adam_step(rule, t, w, now.gradients, m, v)
        w = {**w, **now.statistics, **stepped}
        now = run_pass(w)
        return before

    def state() -> dict[str, Arrays]:
        return {"weight": w, "adam_m": m, "adam_v": v}

    return trained(steps, (first.loss, first.gradients), step, state)


def dsnet_forward(w: Arrays, motion: np.ndarray, run: str) -> Tensors:
    """Every layer; however an engine runs, the LSTM here takes one frame after another."""
    del run
    return prefixed("layer", predict(w, motion))


def dsnet_stream(w: Arrays, motion: np.ndarray) -> Tensors:
    return {"layer/latents": predict_latents(w, motion)}


def dsnet_train(
    w: Arrays, masked: bool, steps: list[int], real: np.ndarray, **clips: np.ndarray
) -> Tensors:
    """Layers in training mode, loss, gradients, steps of Adam."""
    counted = real if masked else None
    first = learn(w, **clips, real=counted)
    learned = train(w, lambda now: learn(now, **clips, real=counted), KERAS_ADAM, steps)
    return {**prefixed("layer", first.outputs), **learned}
