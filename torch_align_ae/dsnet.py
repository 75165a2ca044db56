"""DSNet in PyTorch: the same as `tf_dsnet/model.py`, with Keras's rules where PyTorch differs.

DSNet is trained in Keras. This one is for users of PyTorch alone, and for `dsnet verify`, which
compares the two layer by layer, gradient by gradient and step by step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bridge.errors import DsnetError
from bridge.exchange.weights import (
    BATCH_NORM_EPSILON,
    BATCH_NORM_MOMENTUM,
    KERAS_ADAM,
    MASKED_COUNT_EPSILON,
    AdamRule,
    check_shapes,
    dsnet_shapes,
    dsnet_to_torch,
)
from bridge.paper import DSNET_WIDTHS, INPUT_SIZE, N_BETAS, THETA_SIZE

State = tuple[Tensor, Tensor]


class TanhLinear(nn.Linear):
    """A linear layer followed by tanh, which is one layer in Keras."""

    def forward(self, input: Tensor) -> Tensor:  # noqa: A002
        return torch.tanh(super().forward(input))


class BatchNorm(nn.Module):
    """Keras's batch normalisation over all axes but the last.

    Unlike in `nn.BatchNorm1d`, the running variance is the biased one, and there is a mask: masked
    frames do not count in the statistics, but are normalised like the others.
    """

    running_mean: Tensor
    running_var: Tensor

    def __init__(self, features: int) -> None:
        super().__init__()
        self.epsilon, self.momentum = BATCH_NORM_EPSILON, BATCH_NORM_MOMENTUM
        self.weight = nn.Parameter(torch.ones(features))
        self.bias = nn.Parameter(torch.zeros(features))
        self.register_buffer("running_mean", torch.zeros(features))
        self.register_buffer("running_var", torch.ones(features))

    def forward(self, x: Tensor, real: Tensor | None = None) -> Tensor:
        """Normalise (B, T, features); `real` (B, T) is True for frames that count."""
        mean, variance = self.running_mean, self.running_var
        if self.training:
            mean, variance = _moments(x, real)
            for running, batch in ((self.running_mean, mean), (self.running_var, variance)):
                running.copy_(running * self.momentum + batch.detach() * (1.0 - self.momentum))
        return (x - mean) * (self.weight * torch.rsqrt(variance + self.epsilon)) + self.bias


class DSNet(nn.Module):
    """DSNet (B, T, 79) -> (B, T, 100) (Figure 5, Section 5).

    Keras counts 65,140 parameters, 65,020 of them trainable. PyTorch's LSTM has a second bias,
    which stays 0 and is not trained: two equal biases would learn at twice the speed.
    """

    def __init__(self) -> None:
        super().__init__()
        first, second, units, latents = DSNET_WIDTHS.values()
        self.fc_enc_1 = nn.Linear(INPUT_SIZE, first)
        self.fc_enc_2 = TanhLinear(first, second)
        self.lstm = nn.LSTM(second, units, batch_first=True)
        self.batch_norm = BatchNorm(units)
        self.fc_enc_3 = nn.Linear(units, latents)
        self.lstm.bias_hh_l0.requires_grad_(False)
        self._draw_weights()

    def forward(self, motion: Tensor, real: Tensor | None = None) -> Tensor:
        """Latents of whole motions; `real` (B, T), see `BatchNorm`, matters in training only."""
        return self.step(motion, real=real)[0]

    def step(
        self, motion: Tensor, state: State | None = None, real: Tensor | None = None
    ) -> tuple[Tensor, State]:
        """Latents of the next frames of motions (B, T, 79), and the LSTM's state after them.

        Without a `state` the motions start here.
        """
        if motion.ndim != 3 or motion.shape[-1] != INPUT_SIZE:
            raise DsnetError(
                f"motion of shape {tuple(motion.shape)}",
                f"(B, T, {INPUT_SIZE})",
                f"Join {N_BETAS} betas and {THETA_SIZE} numbers of theta at every frame.",
            )
        memory, after = self.lstm(self.fc_enc_2(self.fc_enc_1(motion)), state)
        return self.fc_enc_3(self.batch_norm(memory, real)), after

    @torch.no_grad()
    def _draw_weights(self) -> None:
        """Initialise weights as Keras does, unlike PyTorch."""
        for name, parameter in self.named_parameters():
            if name == "lstm.weight_hh_l0":
                nn.init.orthogonal_(parameter)
            elif parameter.ndim == 2:
                nn.init.xavier_uniform_(parameter)
            elif name != "batch_norm.weight":
                parameter.zero_()
            if name == "lstm.bias_ih_l0":
                parameter.view(4, -1)[1] = 1.0  # gates i, f, g, o: the forget gate starts open


class KerasAdam(torch.optim.Adam):
    """Adam as in Keras: epsilon is added before the bias correction of the second moment."""

    def __init__(self, parameters: Iterable[nn.Parameter], rule: AdamRule | None = None) -> None:
        rule = rule or KERAS_ADAM
        super().__init__(parameters, rule.learning_rate, (rule.beta_1, rule.beta_2))
        self.epsilon = rule.epsilon

    def step(self, closure: Callable[[], Any] | None = None) -> Any:
        """One step, with the epsilon that makes PyTorch's rule equal to Keras's in this step."""
        for group in self.param_groups:
            states = [self.state[parameter] for parameter in group["params"]]
            step = 1 + max((int(state["step"]) for state in states if state), default=0)
            group["eps"] = self.epsilon / (1.0 - group["betas"][1] ** step) ** 0.5
        return super().step(closure)


def sum_of_distances(target: Tensor, predicted: Tensor, real: Tensor | None = None) -> Tensor:
    """The paper's loss (Section 4.3), as in `tf_dsnet/model.py`.

    Of latents (B, T, 100): sum over t of ||predicted_t - target_t||_2 (not squared), mean over the
    batch. `real` (B, T) is True for frames that count; all of them, padding too, when None. The
    gradient is 0 where a distance is 0.
    """
    squared = (predicted - target).square().sum(-1)  # (B, T)
    nonzero = squared > 0.0
    # The inner `where` keeps the infinite slope of the square root at 0 out of the gradient.
    distance = torch.where(nonzero, torch.where(nonzero, squared, 1.0).sqrt(), 0.0)
    if real is not None:
        distance = torch.where(real, distance, 0.0)
    return distance.sum(-1).mean()


def assign_weights(model: DSNet, weights: Mapping[str, NDArray]) -> None:
    """Set all weights from arrays in Keras's names and layout, such as `fc_enc_1/kernel`."""
    check_shapes(weights, dsnet_shapes(), "DSNet's", "Pass weights written by `dsnet train`.")
    state = {name: torch.from_numpy(array) for name, array in dsnet_to_torch(weights).items()}
    model.load_state_dict(state)


def _moments(x: Tensor, real: Tensor | None) -> tuple[Tensor, Tensor]:
    """Mean and biased variance of each feature, (features,)."""
    if real is None:
        return x.mean((0, 1)), x.var((0, 1), correction=0)
    counted = real[..., None]
    count = counted.sum(dtype=x.dtype) + MASKED_COUNT_EPSILON
    mean = torch.where(counted, x, 0.0).sum((0, 1)) / count
    return mean, torch.where(counted, x - mean, 0.0).square().sum((0, 1)) / count
