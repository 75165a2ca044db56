"""The paper's descent in PyTorch's own words: `torch.optim.SGD`, autograd and the `SMPL` module.

Calls and results are those of `sgd.fit_pose` and `sgd.fit_shape_and_pose`, whose gradient is
written out by hand. Both find the same iterates but for rounding; this one takes several times as
long.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from bridge.runs.workers import progress

# As a module: that one may import this one.
from torch_align_ae.alignment import sgd

if TYPE_CHECKING:
    from torch_align_ae.alignment.mesh_distance import MeshDistance, Shapes


def fit_pose(
    shapes: Shapes, start: tuple[Tensor, ...], target: Tensor, steps: int, descent: sgd.Descent
) -> tuple[Tensor, ...]:
    """Fit pose (B, 22, 3) and translation (B, 3) of fixed shapes to meshes from `arrange`.

    `start` is the initial pose and translation.
    """
    smpl, mesh = shapes.objective.smpl, shapes.objective.restore(target)
    betas = shapes.betas
    return _fitted(lambda *motion: smpl(betas, *motion) - mesh, start, range(steps), descent)


def fit_shape_and_pose(
    objective: MeshDistance, target: Tensor, descent: sgd.Descent
) -> tuple[Tensor, ...]:
    """Fit betas (B, 10), pose (B, 22, 3) and translation (B, 3) to meshes from `arrange`."""
    smpl, mesh = objective.smpl, objective.restore(target)
    betas = target.new_zeros(len(target), len(smpl.shapedirs))
    start = betas, *sgd.rigid_start(objective.shapes(betas), target)
    steps = progress(range(descent.shape_steps), what="shapes", unit="step")
    return _fitted(lambda *body: smpl(*body) - mesh, start, steps, descent)


def _fitted(
    residual: Callable[..., Tensor],
    start: tuple[Tensor, ...],
    steps: Iterable[int],
    descent: sgd.Descent,
) -> tuple[Tensor, ...]:
    """For each body the iterate, the start among them, with the smallest distance, or the last.

    `residual` gives (B, V, 3), metres, whose norm is the distance: not squared, as in the paper.
    """
    variables = [variable.detach().clone().requires_grad_() for variable in start]
    optimizer = torch.optim.SGD(variables, descent.lr, descent.momentum)
    best = [variable.detach().clone() for variable in variables]
    smallest = best[0].new_full((len(best[0]),), torch.inf)
    for _ in steps:
        optimizer.zero_grad()
        with torch.enable_grad():
            distances = torch.linalg.vector_norm(residual(*variables), dim=(1, 2))
            distances.sum().backward()  # the bodies share nothing
        with torch.no_grad():
            closer = distances < smallest
            smallest = torch.fmin(distances, smallest)
            for kept, variable in zip(best, variables, strict=True):
                kept[closer] = variable[closer]
        optimizer.step()
    last = [variable.detach() for variable in variables]
    return tuple(last if descent.iterate == "last" else best)
