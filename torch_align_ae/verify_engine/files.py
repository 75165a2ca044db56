"""Weights through memory and through every file that PyTorch's side can write."""

from __future__ import annotations

import torch

from bridge.exchange import load_weights, save_weights
from bridge.verify.answers import prefixed
from bridge.verify.protocol import Case, Tensors
from torch_align_ae.autoencoder.codes import Codec, Normaliser, read_codec
from torch_align_ae.dsnet import DSNet, assign_weights, named_weights
from torch_align_ae.verify_engine import dsnet, mesh_autoencoder


def formats(case: Case) -> Tensors:
    """Read back what was assigned, and what a fresh network was given by each file."""
    read = _dsnet(case) if case.options["network"] == "dsnet" else _mesh_autoencoder(case)
    kept: Tensors = {}
    for name, weights in read.items():
        kept |= prefixed(f"weight/{name}", weights)
    return kept


def _dsnet(case: Case) -> dict[str, Tensors]:
    first, second, third = dsnet.build(case), DSNet(), DSNet()
    save_weights(case.scratch / "weights.safetensors", named_weights(first))
    assign_weights(second, load_weights(case.scratch / "weights.safetensors"))
    torch.save(first.state_dict(), case.scratch / "network.pt")
    third.load_state_dict(torch.load(case.scratch / "network.pt", weights_only=True))
    read = {"memory": first, "safetensors": second, "state_dict": third}
    return {name: named_weights(network) for name, network in read.items()}


def _mesh_autoencoder(case: Case) -> dict[str, Tensors]:
    first = mesh_autoencoder.build(case, case.weights())
    third = mesh_autoencoder.build(case, {n: 0 * w for n, w in case.weights().items()})
    codec = Codec(first, Normaliser(*torch.rand(2, first.widths[0], 3)))
    codec.save(case.scratch / "codec.safetensors")
    second = read_codec(case.scratch / "codec.safetensors", codec.architecture()).model
    torch.save(first.state_dict(), case.scratch / "network.pt")
    third.load_state_dict(torch.load(case.scratch / "network.pt", weights_only=True))
    read = {"memory": first, "safetensors": second, "state_dict": third}
    return {n: {k: v.numpy() for k, v in m.state_dict().items()} for n, m in read.items()}
