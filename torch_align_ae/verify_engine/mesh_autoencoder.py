"""The mesh autoencoder in PyTorch: every layer, and training as the product trains it."""

from __future__ import annotations

import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bridge.verify.answers import layers, learn
from bridge.verify.protocol import Case, Tensors
from torch_align_ae.autoencoder import MeshAutoencoder
from torch_align_ae.autoencoder.codes import Normaliser
from torch_align_ae.verify_engine.learning import TorchLearner, outputs_of


@torch.inference_mode()
def forward(case: Case) -> Tensors:
    """Every layer, and the normaliser's where the case is in metres."""
    weights = case.weights()
    scaling = [weights.pop(f"normaliser.{name}", None) for name in ("mean_m", "scale_m")]
    model = build(case, weights).eval()

    def run(values: NDArray) -> Tensors:
        modules = [module for module in model.modules() if not list(module.children())]
        with outputs_of(modules) as outputs:
            model(torch.from_numpy(values))
        return dict(zip(_names(model), map(_batch_first, outputs), strict=True))

    if not case.options.get("metres"):
        return layers(case, run, case.inputs()["values"])
    normaliser = Normaliser(*(torch.from_numpy(array) for array in scaling))

    def run_in_metres(offsets_m: NDArray) -> Tensors:
        values = normaliser.normalise(torch.from_numpy(offsets_m)).numpy()
        seen = {"normaliser.normalise": values, **run(values)}
        offsets = normaliser.denormalise(torch.from_numpy(seen["to_coordinates"]))
        return {**seen, "normaliser.denormalise": offsets.numpy()}

    return layers(case, run_in_metres, case.inputs()["offsets_m"])


def train(case: Case) -> Tensors:
    """Loss and gradients of the reconstruction of one batch, and steps on it."""
    model = build(case, case.weights()).train()
    given = {name: torch.from_numpy(array) for name, array in case.inputs().items()}
    target = given.get("target", given["values"])

    def loss() -> Tensor:
        return nn.functional.mse_loss(model(given["values"]), target)

    rate = case.options["adam"]["learning_rate"]
    adam = torch.optim.Adam(model.parameters(), rate, fused=True)
    for group in adam.param_groups:
        group["eps"] = case.options.get("faults", {}).get("adam_epsilon", group["eps"])
    return learn(case, TorchLearner(model, adam, loss, dict))


def build(case: Case, weights: Tensors) -> MeshAutoencoder:
    """The product's network in the case's precision, with these weights."""
    architecture = case.options["architecture"]
    with torch.device("meta"):
        model = MeshAutoencoder(**{**architecture, "widths": tuple(architecture["widths"])})
    state = {name: torch.from_numpy(array) for name, array in weights.items()}
    model.load_state_dict(state, assign=True)
    return model


def _names(model: MeshAutoencoder) -> list[str]:
    """Names of the layers in the order of their calls; one nonlinearity serves many of them."""
    encoder, decoder = (
        [f"{side}.{name}" for name in getattr(model, side)._modules]
        for side in ("encoder", "decoder")
    )
    code = ["to_latent", "from_latent", "from_latent_activation"]
    return [*encoder, *code, *decoder, "to_coordinates"]


def _batch_first(output: NDArray) -> NDArray:
    """Inside, vertices come before the batch."""
    return output.swapaxes(0, 1) if output.ndim == 3 else output
