"""SMPL in PyTorch: forwards, backwards and undone."""

from __future__ import annotations

import torch

from bridge.body import load_body_model
from bridge.verify.answers import prefixed
from bridge.verify.protocol import Case, Tensors
from torch_align_ae.body import SMPL, unpose


def smpl(case: Case) -> Tensors:
    """Parts of the forward pass, the unposed mesh, and the gradient of sum(probe * vertices)."""
    given = {name: torch.from_numpy(array) for name, array in case.inputs().items()}
    body = SMPL(load_body_model(case.options["body"]), getattr(torch, case.dtype))
    motion = {name: given[name] for name in ("betas", "pose", "trans")}
    arguments = {**motion, "offsets": given["offsets"]}
    variables = {name: value.clone().requires_grad_() for name, value in arguments.items()}
    vertices = body(**variables)
    found = torch.autograd.grad((given["probe"] * vertices).sum(), list(variables.values()))
    outputs = {
        "rotations": body.rotations(given["pose"]),
        "joints": body.joints(given["betas"]),
        "rest_vertices": body.rest_vertices(given["betas"], given["pose"]),
        "vertices": vertices.detach(),
        "unposed": unpose(body, given["mesh"], **motion),
    }
    gradients = dict(zip(variables, found, strict=True))
    return prefixed("layer", outputs) | prefixed("grad", gradients)
