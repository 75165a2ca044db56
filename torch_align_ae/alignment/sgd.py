"""The paper's aligner (Section 3.3): gradient descent with momentum on the mesh distance.

The distance is a norm that is not squared, so its gradient does not fade near the optimum: with
the paper's rate the fit circles the optimum at about 2 mm (root mean square over vertices) and
comes no closer however long it runs. That is the method, and it is kept; of the iterates, the
one with the smallest distance is returned, which is Eq. 5's "best matching" theta*.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from torch_align_ae.alignment.objective import MeshDistance, Shapes
from torch_align_ae.body.rotations import matrix_to_axis_angle


@dataclass(frozen=True)
class Descent:
    """How to descend."""

    lr: float = 1e-4
    """Learning rate (paper: 0.0001)."""
    momentum: float = 0.9
    """Momentum (paper: 0.9)."""

    def optimizer(self, *variables: Tensor) -> torch.optim.SGD:
        """A fresh optimizer: each frame is a minimisation of its own."""
        return torch.optim.SGD(variables, lr=self.lr, momentum=self.momentum)


def fit_pose(
    objective: MeshDistance,
    shapes: Shapes,
    start: tuple[Tensor, Tensor],
    target: Tensor,
    steps: int,
    descent: Descent,
    workspace: Tensor,
) -> tuple[Tensor, Tensor]:
    """Pose (B, 22, 3) and translation (B, 3) that bring fixed shapes near meshes from `arrange`.

    `start` is the pose and translation to begin with; `workspace` is `objective.workspace(B)`.
    """
    pose, trans = (tensor.clone() for tensor in start)
    optimizer = descent.optimizer(pose, trans)
    best = _Best(pose, trans)
    for _ in range(steps):
        gradient = objective.gradient(shapes, pose, trans, target, workspace)
        best.keep(gradient.distance, pose, trans)
        pose.grad, trans.grad = gradient.pose, gradient.trans
        optimizer.step()
    return best.variables[0], best.variables[1]


class _Best:
    """The variables of each body at its smallest distance so far: the paper's theta*."""

    def __init__(self, *variables: Tensor) -> None:
        self.variables = [variable.clone() for variable in variables]
        self.distance = variables[0].new_full((len(variables[0]),), torch.inf)

    def keep(self, distance: Tensor, *variables: Tensor) -> None:
        """Take over the bodies that have come closer."""
        closer = distance < self.distance
        self.distance = torch.where(closer, distance, self.distance)
        for kept, now in zip(self.variables, variables, strict=True):
            mask = closer.view(-1, *[1] * (now.ndim - 1))
            torch.where(mask, now, kept, out=kept)


def fit_shape_and_pose(
    objective: MeshDistance,
    target: Tensor,
    steps: int,
    descent: Descent,
    after_step: Callable[[], object] = lambda: None,
) -> tuple[Tensor, Tensor, Tensor]:
    """betas (B, 10), pose (B, 22, 3) and translation (B, 3) of first frames from
    `MeshDistance.arrange`."""
    betas = target.new_zeros(len(target), len(objective.smpl.shapedirs))
    pose, trans = rigid_start(objective, objective.shapes(betas), target)
    workspace = objective.workspace(len(target))
    optimizer = descent.optimizer(betas, pose, trans)
    best = _Best(betas, pose, trans)
    for _ in range(steps):
        shapes = objective.shapes(betas)
        gradient = objective.gradient(shapes, pose, trans, target, workspace)
        best.keep(gradient.distance, betas, pose, trans)
        betas.grad = objective.betas_gradient(gradient)
        pose.grad, trans.grad = gradient.pose, gradient.trans
        optimizer.step()
        after_step()
    return best.variables[0], best.variables[1], best.variables[2]


def rigid_start(objective: MeshDistance, shapes: Shapes, target: Tensor) -> tuple[Tensor, Tensor]:
    """Template pose turned and moved onto the meshes: where a first frame's descent begins.

    The paper does not say where its descent begins; from an unturned body it would not find a
    person who looks the other way.
    """
    centre, target_centre = shapes.vertices.mean(2), target.mean(2)
    source = shapes.vertices - centre[..., None]
    covariance = (target - target_centre[..., None]) @ source.mT
    left, _, right = torch.linalg.svd(covariance.double())
    handedness = torch.ones_like(left[:, 0])
    handedness[:, 2] = torch.det(left @ right)
    turn = ((left * handedness[:, None]) @ right).to(target.dtype)
    root = shapes.joints[:, 0]
    # The root turns about its own joint: R (x - root) + root + trans.
    trans = target_centre - (turn @ (centre - root)[..., None])[..., 0] - root
    pose = torch.zeros_like(shapes.joints)
    pose[:, 0] = matrix_to_axis_angle(turn)
    return pose, trans
