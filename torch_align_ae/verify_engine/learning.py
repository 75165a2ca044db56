"""What both networks have in common: outputs of layers, and steps on one batch."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bridge.verify.protocol import Tensors


@contextmanager
def outputs_of(modules: Sequence[nn.Module]) -> Iterator[list[NDArray]]:
    """Record what these modules return, in the order of their calls.

    Copies, because nonlinearities work in place.
    """
    seen: list[NDArray] = []

    def record(_module: nn.Module, _inputs: object, output: Tensor | tuple[Tensor, ...]) -> None:
        tensor = output[0] if isinstance(output, tuple) else output  # an LSTM's state is second
        seen.append(tensor.detach().numpy().copy())

    hooks = [module.register_forward_hook(record) for module in modules]
    try:
        yield seen
    finally:
        for hook in hooks:
            hook.remove()


class TorchLearner:
    """A network on one batch, to be asked as `bridge.verify.answers.Learner`.

    Parameters
    ----------
    model : in training mode.
    adam : of the parameters that are trained.
    loss : a forward pass.
    canonical : names and layout of arrays that are named as in the model's state.
    """

    def __init__(
        self,
        model: nn.Module,
        adam: torch.optim.Adam,
        loss: Callable[[], Tensor],
        canonical: Callable[[Tensors], Tensors],
    ) -> None:
        self._model, self._adam, self._loss, self._canonical = model, adam, loss, canonical
        self._trained = {n: p for n, p in model.named_parameters() if p.requires_grad}

    def first_pass(self) -> tuple[float, Tensors]:
        """Loss and gradients; the running statistics stay where they were."""
        before = {name: buffer.clone() for name, buffer in self._model.named_buffers()}
        loss = self._pass()
        for name, buffer in self._model.named_buffers():
            buffer.copy_(before[name])
        gradients = {
            name: p.grad.numpy() for name, p in self._trained.items() if p.grad is not None
        }
        return loss, self._canonical(gradients)

    def step(self) -> float:
        """Take one step; the loss before it."""
        loss = self._pass()
        self._adam.step()
        return loss

    def state(self) -> dict[str, Tensors]:
        """Weights and Adam's moments."""
        weights = {name: v.detach().numpy().copy() for name, v in self._model.state_dict().items()}
        moments = {
            kind: {n: self._adam.state[p][key].numpy().copy() for n, p in self._trained.items()}
            for kind, key in (("adam_m", "exp_avg"), ("adam_v", "exp_avg_sq"))
        }
        return {k: self._canonical(a) for k, a in ({"weight": weights} | moments).items()}

    def _pass(self) -> float:
        self._adam.zero_grad()
        loss = self._loss()
        loss.backward()
        return loss.item()
