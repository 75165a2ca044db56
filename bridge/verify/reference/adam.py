"""Adam, in both forms of its epsilon, and training by it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from bridge.exchange.weights import AdamRule

Arrays = dict[str, np.ndarray]


@dataclass(frozen=True)
class Pass:
    """One forward and backward pass."""

    loss: float
    gradients: Arrays
    """By trainable parameter."""
    statistics: Arrays
    """Weights that the pass itself moves on: the running statistics."""


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
    weights: Arrays, run_pass: Callable[[Arrays], Pass], rule: AdamRule, snapshots: Iterable[int]
) -> Arrays:
    """Take steps on one batch, as the contract of the engines names what they leave.

    Parameters
    ----------
    weights : before the first step.
    run_pass : forward and backward pass with given weights.
    snapshots : numbers of steps after which weights and moments are kept.

    Returns
    -------
    `loss` and `grad/...` of the first pass; `losses` before each step;
    `step_n/weight/...`, `step_n/adam_m/...`, `step_n/adam_v/...` for n in `snapshots`.
    """
    wanted = set(snapshots)
    now = run_pass(weights)
    kept = {"loss": np.array([now.loss])}
    kept |= {f"grad/{name}": gradient for name, gradient in now.gradients.items()}
    first = {name: np.zeros_like(gradient) for name, gradient in now.gradients.items()}
    second, losses = dict(first), []
    for t in range(1, max(wanted, default=0) + 1):
        losses.append(now.loss)
        stepped, first, second = adam_step(rule, t, weights, now.gradients, first, second)
        weights = {**weights, **now.statistics, **stepped}
        if t in wanted:
            state = {"weight": weights, "adam_m": first, "adam_v": second}
            for kind, arrays in state.items():
                kept |= {f"step_{t}/{kind}/{name}": array for name, array in arrays.items()}
        now = run_pass(weights)
    return {**kept, "losses": np.array(losses)} if losses else kept
