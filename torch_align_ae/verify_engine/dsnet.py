"""DSNet's PyTorch twin: every layer, and training as Keras trains."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import torch
from numpy.typing import NDArray
from torch import Tensor

from bridge.exchange.weights import KERAS_ADAM, dsnet_from_torch
from bridge.verify.answers import joined, layers, learn, prefixed
from bridge.verify.protocol import Case, Tensors
from torch_align_ae.dsnet import DSNet, KerasAdam, State, assign_weights, sum_of_distances
from torch_align_ae.verify_engine.learning import TorchLearner, outputs_of

LAYERS = ("fc_enc_1", "fc_enc_2", "lstm", "batch_norm", "fc_enc_3")


@torch.inference_mode()
def forward(case: Case) -> Tensors:
    """Every layer at rest: the whole batch, row by row, or frame by frame."""
    model, motion = build(case).eval(), case.inputs()["motion"]
    if case.options["run"] == "steps":
        return joined(_frames(model, torch.from_numpy(motion)), axis=1)
    return layers(case, lambda x: _seen(model, lambda: model(torch.from_numpy(x))), motion)


def train(case: Case) -> Tensors:
    """Layers, loss and gradients of the first pass in training, and the steps after it."""
    faults = case.options.get("faults", {})
    given = {name: torch.from_numpy(array) for name, array in case.inputs().items()}
    masked = case.options["masked"] and not faults.get("forget_mask")
    real = given["real"] if masked else None
    model = build(case).train()

    def loss() -> Tensor:
        return sum_of_distances(given["latents"], model(given["motion"], real), real)

    rate = case.options["adam"]["learning_rate"]
    adam = KerasAdam(model.parameters(), replace(KERAS_ADAM, learning_rate=rate))
    adam.epsilon = faults.get("adam_epsilon", adam.epsilon)
    seen = prefixed("layer", _seen(model, loss))
    assign_weights(model, case.weights())  # the pass has moved the running statistics on
    return seen | learn(case, TorchLearner(model, adam, loss, dsnet_from_torch))


def build(case: Case) -> DSNet:
    """The twin in the case's precision, with its weights and its faults."""
    model = DSNet().to(getattr(torch, case.dtype))
    assign_weights(model, case.weights())
    faults, norm = case.options.get("faults", {}), model.batch_norm
    norm.epsilon = faults.get("batch_norm_epsilon", norm.epsilon)
    norm.momentum = faults.get("batch_norm_momentum", norm.momentum)
    return model


def _seen(model: DSNet, run: Callable[[], object]) -> Tensors:
    with outputs_of([model.get_submodule(name) for name in LAYERS]) as outputs:
        run()
    return dict(zip(LAYERS, outputs, strict=True))


def _frames(model: DSNet, motion: Tensor) -> Iterator[dict[str, NDArray]]:
    """Every layer at one frame after another; the LSTM's state is carried by hand."""
    state: State | None = None
    for frame in motion.split(1, dim=1):
        with outputs_of([model.get_submodule(name) for name in LAYERS]) as outputs:
            _latents, state = model.step(frame, state)
        yield dict(zip(LAYERS, outputs, strict=True))
