"""One training step of the autoencoder against its peers and its limit.

Section 5 claims that the mesh autoencoder trains faster than Casas and Otaduy's
network. Both take the same batch through the same step, turn by turn in one
process, and the medians are compared: once with Adam fused into one pass, the
best of both, and once with Adam as PyTorch ships it, which the paper used. The
multiplications of one frame are nearly equal (302 against 285 million), so that
what the smaller network saves is memory traffic, above all Adam's. The limit is
what one large matrix product reaches in the same minute on the same cores.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from benchmarks.processes import run_as_process
from benchmarks.speed.results import write_results
from bridge.options import PositiveInt, Seed
from bridge.paper import FEATURES, N_VERTICES
from bridge.runs.writer import machine
from torch_align_ae import CasasOtaduyAutoencoder
from torch_align_ae.autoencoder.mesh_autoencoder import (
    MeshAutoencoder,
    VertexConv,
    parameter_count,
)
from torch_align_ae.autoencoder.training import keep_freed_memory
from torch_align_ae.workers import device

_GEMM_SIZE = 2048


@dataclass(frozen=True)
class TorchBenchConfig:
    """Time training steps of both autoencoders: about a minute on two cores, 7 GB of memory."""

    run: str = "demo"
    """Folder under runs/ that receives bench/torch.json."""
    seed: Seed = 0
    """Seed of the random offsets and weights."""
    batch_size: PositiveInt = 64
    """Frames a step; the paper's is 64."""
    rounds: PositiveInt = 5
    """Timed steps of each contender, after one that warms it up."""


def main(config: TorchBenchConfig) -> None:
    """Measure, and write runs/<run>/bench/torch.json."""
    write_results(config.run, "torch", measure(config))


def measure(config: TorchBenchConfig) -> dict[str, Any]:
    """Median seconds of every contender, their ratio, and the share of the machine's limit."""
    keep_freed_memory()
    torch.manual_seed(config.seed)
    with device():
        offsets = torch.randn(config.batch_size, N_VERTICES, 3)
        mesh, casas = MeshAutoencoder(), CasasOtaduyAutoencoder()
        square = torch.randn(_GEMM_SIZE, _GEMM_SIZE)
    conv1d = partial(conv1d_forward, mesh)
    # All forms of a network share weights and moments: copies would cost gigabytes.
    mesh_adam, casas_adam = _adam(mesh), _adam(casas)
    contenders: dict[str, Callable[[], object]] = {
        "mesh_autoencoder": training_step(mesh_adam, mesh, offsets),
        "mesh_autoencoder_bfloat16": training_step(mesh_adam, mesh, offsets, bfloat16=True),
        "mesh_autoencoder_conv1d": training_step(mesh_adam, conv1d, offsets),
        "mesh_autoencoder_plain_adam": training_step(mesh_adam, mesh, offsets, fused=False),
        "casas_otaduy": training_step(casas_adam, casas, offsets),
        "casas_otaduy_plain_adam": training_step(casas_adam, casas, offsets, fused=False),
        "gemm": lambda: square @ square,
    }
    seconds = interleaved_seconds(contenders, config.rounds, device())
    medians = {name: statistics.median(values) for name, values in seconds.items()}
    return {
        "batch_size": config.batch_size,
        "seconds": seconds,
        "median_s": medians,
        "mesh_to_casas_otaduy": medians["mesh_autoencoder"] / medians["casas_otaduy"],
        "mesh_to_casas_otaduy_plain_adam": (
            medians["mesh_autoencoder_plain_adam"] / medians["casas_otaduy_plain_adam"]
        ),
        "bfloat16_to_float32": medians["mesh_autoencoder_bfloat16"] / medians["mesh_autoencoder"],
        "gemm_to_conv1d": medians["mesh_autoencoder"] / medians["mesh_autoencoder_conv1d"],
        "gflops": _gflops(mesh, casas, config.batch_size, medians),
        "parameters": {
            "mesh_autoencoder": parameter_count(mesh),
            "casas_otaduy": parameter_count(casas),
        },
        "machine": f"{machine()}, {device().type}",
        "gpu": gpu_name(),
        "threads": torch.get_num_threads(),
        "torch": torch.__version__,
    }


def gpu_name() -> str | None:
    """Such as `NVIDIA H100 80GB HBM3`; times say nothing without."""
    return torch.cuda.get_device_name() if device().type == "cuda" else None


def interleaved_seconds(
    contenders: Mapping[str, Callable[[], object]],
    rounds: int,
    device: torch.device,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, list[float]]:
    """Seconds of `rounds` calls each, turn by turn, so that other load hits all alike."""
    seconds: dict[str, list[float]] = {name: [] for name in contenders}
    for turn in range(rounds + 1):
        for name, call in contenders.items():
            started = clock()
            call()
            if device.type == "cuda":
                torch.cuda.synchronize()
            if turn > 0:
                seconds[name].append(clock() - started)
    return seconds


def training_step(
    adam: torch.optim.Adam,
    forward: Callable[[Tensor], Tensor],
    offsets: Tensor,
    *,
    fused: bool = True,
    bfloat16: bool = False,
) -> Callable[[], None]:
    """A step of `Training` on one batch of normalised offsets (B, V, 3)."""

    def step() -> None:
        adam.param_groups[0]["fused"] = fused
        with torch.autocast(offsets.device.type, torch.bfloat16, enabled=bfloat16):
            loss = nn.functional.mse_loss(forward(offsets), offsets)
        loss.backward()
        adam.step()
        # Gradients kept between turns would cost another gigabyte.
        adam.zero_grad()

    return step


def _adam(model: nn.Module) -> torch.optim.Adam:
    return torch.optim.Adam(model.parameters(), 1e-4, fused=True)


def conv1d_forward(model: MeshAutoencoder, offsets: Tensor) -> Tensor:
    """The same network with batch-first `Conv1d`, layer by layer: oracle and peer of the fast form.

    Takes and returns normalised offsets (B, V, 3).
    """
    features = offsets  # (B, V, C): Conv1d's channels are the vertices
    for layer in model.encoder:
        features = _plain(layer, features)
    latents = model.to_latent(features.flatten(1))
    features = model.activate(model.from_latent(latents))
    features = features.view(-1, model.widths[-1], FEATURES[-1])
    for layer in model.decoder:
        features = _plain(layer, features)
    return model.to_coordinates(features)


def _plain(layer: nn.Module, features: Tensor) -> Tensor:
    if isinstance(layer, VertexConv):
        return functional.conv1d(features, layer.weight, layer.bias)
    return layer(features)


def _gflops(
    mesh: MeshAutoencoder, casas: CasasOtaduyAutoencoder, batch: int, medians: dict[str, float]
) -> dict[str, float]:
    """Reached GFLOP/s; a training step multiplies three times: forward, input, weights."""
    mixing = 2 * sum(a * b for a, b in pairwise(mesh.widths))
    products = {
        "mesh_autoencoder": 3 * batch * FEATURES[-1] * mixing,
        "casas_otaduy": 3 * batch * parameter_count(casas),
        "gemm": _GEMM_SIZE**3,
    }
    return {name: 2e-9 * count / medians[name] for name, count in products.items()}


if __name__ == "__main__":
    run_as_process(TorchBenchConfig, main)
