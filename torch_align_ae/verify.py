"""`python -m torch_align_ae.verify`: results of PyTorch for `dsnet verify`.

Operations and names are those of `bridge.exchange.engine`. They are computed by the networks,
optimizers and SMPL that the product uses.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bridge.body import load_body_model
from bridge.exchange.engine import NORMALISER, Tensors, batches, joined, prefixed, serve, trained
from bridge.exchange.weights import KERAS_ADAM, TORCH_ADAM, dsnet_from_torch
from bridge.tissue.trained_plus import TrainedPlus
from torch_align_ae.alignment import sgd, stock_sgd
from torch_align_ae.alignment.mesh_distance import MeshDistance
from torch_align_ae.autoencoder.codes import Codec, Normaliser
from torch_align_ae.autoencoder.mesh_autoencoder import MeshAutoencoder
from torch_align_ae.body import SMPL, unpose
from torch_align_ae.dsnet import DSNet, KerasAdam, assign_weights, sum_of_distances
from torch_align_ae.tissue import SoftTissue
from torch_align_ae.tissue.windows import TissueWindows

LAYERS = ("fc_enc_1", "fc_enc_2", "lstm", "batch_norm", "fc_enc_3")
Options = dict[str, Any]


@torch.inference_mode()
def dsnet_forward(weights: Tensors, motion: NDArray, run: str) -> Tensors:
    """Outputs of every layer in inference: the whole batch, row by row, or frame by frame."""
    model = _dsnet(weights).eval()
    if run != "steps":
        parts = batches(motion, run)
        return joined(_layers(model, model, _tensor(rows))[0] for rows in parts)
    frames, state = [], None
    for frame in _tensor(motion).split(1, dim=1):
        outputs, (_latents, state) = _layers(model, model.step, frame, state)
        frames.append(outputs)
    return joined(frames, axis=1)


def dsnet_train(weights: Tensors, masked: bool, steps: list[int], **clips: NDArray) -> Tensors:
    """Layers, loss and gradients of a first training pass, and the training steps after it."""
    given = {name: _tensor(array) for name, array in clips.items()}
    real = given["real"] if masked else None
    model = _dsnet(weights).train()

    def loss() -> Tensor:
        return sum_of_distances(given["latents"], model(given["motion"], real), real)

    adam = KerasAdam(model.parameters())
    seen = prefixed("layer", _layers(model, loss)[0])
    assign_weights(model, weights)  # the pass has changed the running statistics
    return seen | _trained(model, adam, loss, dsnet_from_torch, steps)


@torch.inference_mode()
def ae_forward(
    weights: Tensors, values: NDArray, architecture: Options, run: str, bfloat16: bool = False
) -> Tensors:
    """Outputs of every layer, and of the normaliser if the weights contain one."""
    scaling = [weights.pop(name) for name in NORMALISER if name in weights]
    model = _autoencoder(weights, architecture).eval()
    # Many layers share one nonlinearity module, so outputs are named in the order of the calls.
    sides = ("encoder", "decoder")
    encoder, decoder = ([f"{s}.{n}" for n in getattr(model, s)._modules] for s in sides)
    code = ("to_latent", "from_latent", "from_latent_activation")
    names = [*encoder, *code, *decoder, "to_coordinates"]
    modules = [module for module in model.modules() if not list(module.children())]

    def layers(rows: Tensor) -> Tensors:
        with _autocast(bfloat16):
            outputs, _restored = _outputs(modules, model, rows)
        # Inside, vertices come before the batch.
        batch_first = [o.swapaxes(0, 1) if o.ndim == 3 else o for o in outputs]
        return dict(zip(names, batch_first, strict=True))

    if not scaling:
        return joined(layers(_tensor(rows)) for rows in batches(values, run))
    normaliser = Normaliser(*(_tensor(array) for array in scaling))
    normalised = normaliser.normalise(_tensor(values))
    outputs = {"normaliser.normalise": _array(normalised), **layers(normalised)}
    last = _tensor(outputs["to_coordinates"])
    outputs["normaliser.denormalise"] = _array(normaliser.denormalise(last))
    return prefixed("layer", outputs)


def ae_train(
    weights: Tensors,
    values: NDArray,
    architecture: Options,
    steps: list[int],
    target: NDArray | None = None,
    bfloat16: bool = False,
) -> Tensors:
    """Loss and gradients of reconstructing one batch, and training steps on it."""
    model = _autoencoder(weights, architecture).train()
    inputs = _tensor(values)
    expected = inputs if target is None else _tensor(target)

    def loss() -> Tensor:
        with _autocast(bfloat16):
            return nn.functional.mse_loss(model(inputs), expected)

    adam = torch.optim.Adam(model.parameters(), TORCH_ADAM.learning_rate, fused=True)
    return _trained(model, adam, loss, dict, steps)


def smpl(mesh: NDArray, probe: NDArray, body: str, **arguments: NDArray) -> Tensors:
    """Parts of the forward pass, the unposed mesh, and the gradients of sum(probe * vertices)."""
    given = {name: _tensor(array) for name, array in arguments.items()}
    posed = _body(body, given["pose"])
    variables = {name: value.clone().requires_grad_() for name, value in given.items()}
    vertices = posed(**variables)
    total = (_tensor(probe) * vertices).sum()
    gradients = torch.autograd.grad(total, list(variables.values()))
    motion = {name: given[name] for name in ("betas", "pose", "trans")}
    outputs = {
        "rotations": posed.rotations(given["pose"]),
        "joints": posed.joints(given["betas"]),
        "rest_vertices": posed.rest_vertices(given["betas"], given["pose"]),
        "vertices": vertices.detach(),
        "unposed": unpose(posed, _tensor(mesh), **motion),
    }
    named = dict(zip(variables, gradients, strict=True))
    return {
        **prefixed("layer", {name: _array(output) for name, output in outputs.items()}),
        **prefixed("grad", {name: _array(gradient) for name, gradient in named.items()}),
    }


def descent(body: str, mesh: NDArray, steps: int, **start: NDArray) -> Tensors:
    """The closest iterates of a descent to meshes, and their distances.

    It fits pose and translation from `start` at its betas, or, without a start, the shape too.
    """
    given = {name: _tensor(array) for name, array in start.items()}
    meshes = _tensor(mesh)
    posed, settings = _body(body, meshes), sgd.Descent(shape_steps=steps)
    objective = MeshDistance(posed)
    target = objective.arrange(meshes)

    def found_by(fit: ModuleType) -> Tensors:
        if given:
            betas, begin = given["betas"], (given["pose"], given["trans"])
            motion = fit.fit_pose(objective.shapes(betas), begin, target, steps, settings)
        else:
            betas, *motion = fit.fit_shape_and_pose(objective, target, settings)
        found = dict(zip(("betas", "pose", "trans"), (betas, *motion), strict=True))
        distances = torch.linalg.vector_norm(posed(**found) - meshes, dim=(1, 2))
        fitted = {name: array for name, array in found.items() if not given or name != "betas"}
        return {name: _array(t) for name, t in {**fitted, "distances": distances}.items()}

    return prefixed("descent", found_by(sgd)) | prefixed("stock descent", found_by(stock_sgd))


def oscillators_train(
    weights: Tensors, steps: list[int], learning_rate: float, **windows: NDArray
) -> Tensors:
    """Offsets of windows, loss and gradients of a first pass, and the training steps after it."""
    # Normalise again: unit vectors that were stored in float32 have eight digits.
    windows["normals"] /= np.linalg.norm(windows["normals"], axis=-1, keepdims=True)
    given = {name: _tensor(array) for name, array in windows.items()}
    model = TissueWindows({n: _tensor(a) for n, a in weights.items()}, given.pop("laplacian"))
    rule = replace(KERAS_ADAM, learning_rate=learning_rate, beta_2=0.95)
    adam = KerasAdam(model.parameters(), rule)
    with torch.no_grad():
        offsets = _array(model(given))

    def loss() -> tuple[Tensor, Tensor]:
        shown, prior = model.loss(given)
        return shown, shown + prior

    return {"layer/offsets": offsets, **_trained(model, adam, loss, dict, steps)}


@torch.no_grad()
def soft_tissue(weights: Tensors, theta: NDArray, betas: NDArray, body: str) -> Tensors:
    """Offsets (T, B, V, 3) of the skin of B people with poses theta (T, B, 69)."""
    layer, motion = _soft_tissue(weights, theta, body), _tensor(theta).transpose(0, 1)
    return {"layer/offsets": _array(layer(motion, _tensor(betas))[0].transpose(0, 1))}


def soft_tissue_slopes(
    weights: Tensors, theta: NDArray, betas: NDArray, probe: NDArray, body: str, **towards: NDArray
) -> Tensors:
    """How sum(probe * offsets) grows in each direction `towards/NAME`, by its gradient."""
    layer = _soft_tissue(weights, theta, body)
    variables = {"theta": _tensor(theta), "betas": _tensor(betas)}
    for variable in variables.values():
        variable.requires_grad_()
    variables |= {n.replace("log_coefficients.", "log_"): p for n, p in layer.named_parameters()}
    offsets, _ = layer(variables["theta"].transpose(0, 1), variables["betas"])
    total = (_tensor(probe) * offsets.transpose(0, 1)).sum()
    names = [name.removeprefix("towards/") for name in towards]
    gradients = torch.autograd.grad(total, [variables[name] for name in names])
    slopes = {
        name: _array(_tensor(some).flatten(1) @ gradient.flatten())
        for name, some, gradient in zip(names, towards.values(), gradients, strict=True)
    }
    return prefixed("grad", slopes)


def _soft_tissue(weights: Tensors, like: NDArray, body: str) -> SoftTissue:
    layer = SoftTissue(
        TrainedPlus.from_arrays(weights), load_body_model(body), _tensor(like[:0]).dtype
    )
    return layer.to(torch.get_default_device())


def _dsnet(weights: Tensors) -> DSNet:
    """DSNet in the precision of the weights."""
    model = DSNet().to(_tensor(weights["lstm/bias"]).dtype)
    assign_weights(model, weights)
    return model


def _body(path: str, like: Tensor) -> SMPL:
    return SMPL(load_body_model(path), like.dtype).to(like.device)


def _autoencoder(weights: Tensors, architecture: Options) -> MeshAutoencoder:
    model = Codec.empty(architecture).model
    state = {name: _tensor(array) for name, array in weights.items()}
    model.load_state_dict(state, assign=True)
    return model


def _layers(model: DSNet, call: Callable[..., Any], *arguments: Any) -> tuple[Tensors, Any]:
    modules = [model.get_submodule(name) for name in LAYERS]
    outputs, returned = _outputs(modules, call, *arguments)
    return dict(zip(LAYERS, outputs, strict=True)), returned


def _outputs(
    modules: Sequence[nn.Module], call: Callable[..., Any], *arguments: Any
) -> tuple[list[NDArray], Any]:
    """Outputs of modules during a call, in order, and the result of the call.

    Outputs are copied, as nonlinearities work in place.
    """
    recorded: list[NDArray] = []

    def record(_module: nn.Module, _inputs: object, output: Tensor | tuple[Tensor, ...]) -> None:
        tensor = output[0] if isinstance(output, tuple) else output  # an LSTM returns its state too
        recorded.append(_array(tensor))

    hooks = [module.register_forward_hook(record) for module in modules]
    returned = call(*arguments)
    for hook in hooks:
        hook.remove()
    return recorded, returned


def _trained(
    model: nn.Module,
    adam: torch.optim.Adam,
    loss: Callable[[], Tensor | tuple[Tensor, Tensor]],
    canonical: Callable[[Tensors], Tensors],
    steps: list[int],
) -> Tensors:
    """Train on one batch; `canonical` gives arrays of the model's state their names in `bridge`.

    `loss` gives what is shown, and, if it is another, what is minimised.
    """
    learned = {name: p for name, p in model.named_parameters() if p.requires_grad}

    def one_pass() -> float:
        adam.zero_grad()
        value = loss()
        shown, minimised = value if isinstance(value, tuple) else (value, value)
        minimised.backward()
        return shown.item()

    def step() -> float:
        value = one_pass()
        adam.step()
        return value

    def state() -> dict[str, Tensors]:
        arrays = {"weight": {n: _array(v) for n, v in model.state_dict().items()}}
        for kind, key in (("adam_m", "exp_avg"), ("adam_v", "exp_avg_sq")):
            arrays[kind] = {n: _array(adam.state[p][key]) for n, p in learned.items()}
        return {kind: canonical(named) for kind, named in arrays.items()}

    before = {name: buffer.clone() for name, buffer in model.named_buffers()}
    first = one_pass()
    for name, buffer in model.named_buffers():
        buffer.copy_(before[name])
    gradients = {name: _array(p.grad) for name, p in learned.items() if p.grad is not None}
    return trained(steps, (first, canonical(gradients)), step, state)


def _tensor(array: NDArray) -> Tensor:
    """In memory where this engine computes."""
    return torch.from_numpy(array).to(torch.get_default_device())


def _array(tensor: Tensor) -> NDArray:
    """A copy; what was computed in bfloat16 in float32."""
    tensor = tensor.detach()
    wide = tensor.float() if tensor.dtype == torch.bfloat16 else tensor
    return wide.cpu().numpy().copy()


def _autocast(bfloat16: bool) -> torch.autocast:
    """As a training step of the autoencoder runs in bfloat16."""
    device = torch.get_default_device().type
    return torch.autocast(device, torch.bfloat16, enabled=bfloat16)


def here(engine: str) -> str:
    """Why there is no such engine here; that of a GPU computes there from now on."""
    if engine.endswith("-gpu"):
        if not torch.cuda.is_available():
            return "PyTorch finds no GPU"
        torch.set_default_device("cuda")
        torch.backends.cudnn.allow_tf32 = False  # ten bits: no float32
    return ""


OPERATIONS = (
    dsnet_forward, dsnet_train, ae_forward, ae_train, smpl, descent, oscillators_train,
    soft_tissue, soft_tissue_slopes,
)  # fmt: skip

if __name__ == "__main__":
    serve(*OPERATIONS, packages=("torch",), here=here)
