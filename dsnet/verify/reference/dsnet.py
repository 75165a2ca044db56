"""DSNet (Section 5, Figure 5), forward and backward, and Adam."""

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
    """One forward and backward pass in training mode."""

    loss: float
    gradients: Arrays
    """By trainable parameter."""
    statistics: Arrays
    """The updated running statistics."""
    outputs: Arrays
    """By layer."""


def predict(w: Arrays, motion: np.ndarray) -> Arrays:
    """Every layer's output for whole clips (B, T, 79), with the running statistics."""
    outputs, _steps = _up_to_lstm(w, motion)
    return _from_lstm(w, outputs, w["batch_norm/moving_mean"], w["batch_norm/moving_variance"])


def predict_latents(w: Arrays, motion: np.ndarray) -> np.ndarray:
    """Latents (B, T, 100) of motions (B, T, 79); unscaled if the weights have `scaling/...`."""
    if "scaling/input_mean" in w:
        motion = (motion - w["scaling/input_mean"]) / w["scaling/input_std"]
    latents = predict(w, motion)["fc_enc_3"]
    if "scaling/latent_mean" in w:
        latents = latents * w["scaling/latent_std"] + w["scaling/latent_mean"]
    return latents


def learn(
    w: Arrays, motion: np.ndarray, latents: np.ndarray, real: np.ndarray | None = None
) -> Pass:
    """Loss and gradients of a batch, which is normalised by its own statistics.

    `motion` is (B, T, 79), `latents` (B, T, 100); without `real` (B, T) all frames count.
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
    of_batch = {"batch_norm/moving_mean": batch.mean, "batch_norm/moving_variance": batch.variance}
    momentum = BATCH_NORM_MOMENTUM
    statistics = {n: momentum * w[n] + (1 - momentum) * new for n, new in of_batch.items()}
    return Pass(loss, g, statistics, outputs)


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
        correction_1, correction_2 = 1 - rule.beta_1**t, 1 - rule.beta_2**t
        if rule.epsilon_hat:
            change = m * np.sqrt(correction_2) / (np.sqrt(v) + rule.epsilon)
        else:
            change = m / (np.sqrt(v / correction_2) + rule.epsilon)
        new_weights[name] = weights[name] - rule.learning_rate / correction_1 * change
        new_first[name], new_second[name] = m, v
    return new_weights, new_first, new_second


def train(
    weights: Arrays, run_pass: Callable[[Arrays], Pass], rule: AdamRule, steps: Sequence[int]
) -> Tensors:
    """Train by Adam; the tensors of `bridge.exchange.engine.trained` after each of `steps`."""
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
    """Every layer's output; `run` is ignored, as the LSTM always runs frame by frame here."""
    del run
    return prefixed("layer", predict(w, motion))


def dsnet_stream(w: Arrays, motion: np.ndarray) -> Tensors:
    """Latents of motions (B, T, 79)."""
    return {"layer/latents": predict_latents(w, motion)}


def dsnet_exported(w: Arrays, motion: np.ndarray, form: str, saved: str = "") -> Tensors:
    """The same: what a file gives that `dsnet export` makes of a network."""
    del form, saved
    return dsnet_stream(w, motion)


def dsnet_train(
    w: Arrays, masked: bool, steps: list[int], real: np.ndarray, **clips: np.ndarray
) -> Tensors:
    """Layers in training mode, loss, gradients, steps of Adam."""
    mask = real if masked else None
    first = learn(w, **clips, real=mask)
    trained = train(w, lambda now: learn(now, **clips, real=mask), KERAS_ADAM, steps)
    return {**prefixed("layer", first.outputs), **trained}


def dsnet_fit(w: Arrays, steps: list[int], **clips: np.ndarray) -> Tensors:
    """What the same steps leave, of `dsnet_train` without a mask."""
    trained = dsnet_train(w, masked=False, steps=steps, **clips)
    return {name: a for name, a in trained.items() if name.startswith(("step_", "losses"))}
