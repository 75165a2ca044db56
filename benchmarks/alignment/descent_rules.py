"""The paper's descent followed over a clip, with the rule that ends a frame left open."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from torch_align_ae.alignment.mesh_distance import Shapes
from torch_align_ae.alignment.sgd import Descent, MomentumDescent, batches
from torch_align_ae.workers import torch_workers


@dataclass(frozen=True)
class Rule:
    """When a frame's descent ends. The paper does not say."""

    steps: int
    """Steps for each frame, or the most that it may take."""
    patience: int | None = None
    """Ends a frame when its mesh has come no closer for so many steps."""
    decays: bool = False
    """Whether the rate falls to zero over a frame's steps: a departure from the paper's SGD."""

    @property
    def kind(self) -> str:
        """Name of the family that it belongs to."""
        return "decayed" if self.decays else "fixed" if self.patience is None else "patience"


@dataclass(frozen=True)
class ClipSet:
    """Frames of B clips of equal length, and what each of them starts from."""

    shapes: Shapes
    """B bodies."""
    targets: Tensor
    """(T, B, 3 V) meshes from `MeshDistance.arrange`, metres."""
    pose: Tensor
    """(B, 22, 3) of the frame before the first, radians."""
    trans: Tensor
    """(B, 3) of the frame before the first, metres."""


class Tracked(NamedTuple):
    """What a rule gave."""

    pose: Tensor
    """(B, T, 22, 3) radians."""
    trans: Tensor
    """(B, T, 3) metres."""
    steps: Tensor
    """(B, T) steps that were taken."""


def track(clips: ClipSet, rule: Rule, descent: Descent) -> Tracked:
    """Fit every frame by `rule`, each started from the one before; both cores are used."""

    def follow(clips: ClipSet, rows: list[int]) -> tuple[Tensor, ...]:
        shapes = clips.shapes.rows(rows)
        pose, trans, found = clips.pose[rows], clips.trans[rows], []
        for target in clips.targets:
            pose, trans, steps = _fit(shapes, (pose, trans), target[rows], rule, descent)
            found.append((pose, trans, steps))
        return tuple(torch.stack(parts, 1) for parts in zip(*found, strict=True))

    with torch_workers("threads", clips) as pool:
        found = list(pool.map(follow, batches(len(clips.pose))))
    return Tracked(*(torch.cat(parts) for parts in zip(*found, strict=True)))


@torch.inference_mode()
def _fit(
    shapes: Shapes,
    start: tuple[Tensor, Tensor],
    target: Tensor,
    rule: Rule,
    descent: Descent,
) -> tuple[Tensor, Tensor, Tensor]:
    """`fit_pose` under a rule; also gives the steps that each body took, (B,)."""
    distance, descending = shapes.objective.to(target), MomentumDescent(descent, *start)
    patience = rule.steps if rule.patience is None else rule.patience
    waited, steps = torch.zeros(2, len(target), dtype=torch.int64)
    smallest = target.new_full((len(target),), torch.inf)
    pose, trans = start
    for step in range(rule.steps):
        if rule.decays:
            descending.rate = descent.lr * (1 - step / rule.steps)
        gradient = distance.gradient(shapes, *descending.variables)
        closer = gradient.distance < smallest
        smallest = torch.fmin(gradient.distance, smallest)
        descending.step(*gradient)
        going = waited < patience
        best_pose, best_trans = descending.best()
        pose = torch.where(going[:, None, None], best_pose, pose)
        trans = torch.where(going[:, None], best_trans, trans)
        steps += going
        # A body that has stopped stays so.
        waited = torch.where(closer & going, 0, waited + 1)
        if not going.any():
            break
    return pose, trans, steps
