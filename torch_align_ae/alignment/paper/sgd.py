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

from torch_align_ae.alignment.paper.objective import MeshDistance, Shapes
from torch_align_ae.body.rotations import matrix_to_axis_angle, nearest_rotation


@dataclass(frozen=True)
class Descent:
    """How to descend."""

    lr: float = 1e-4
    """Learning rate (paper: 0.0001)."""
    momentum: float = 0.9
    """Momentum (paper: 0.9)."""


def fit_pose(
    objective: MeshDistance,
    shapes: Shapes,
    start: tuple[Tensor, Tensor],
    target: Tensor,
    steps: int,
    descent: Descent,
) -> tuple[Tensor, Tensor]:
    """Pose (B, 22, 3) and translation (B, 3) that bring fixed shapes near meshes from `arrange`.

    `start` is the pose and translation to begin with.
    """
    with torch.inference_mode():
        distance = objective.to(target)
        descending = Descending(descent, *start)
        for _ in range(steps):
            gradient = distance.gradient(shapes, *descending.variables)
            descending.step(gradient.distance, gradient.pose, gradient.trans)
    pose, trans = descending.best()
    return pose, trans


def fit_shape_and_pose(
    objective: MeshDistance,
    target: Tensor,
    steps: int,
    descent: Descent,
    after_step: Callable[[], object] = lambda: None,
) -> tuple[Tensor, Tensor, Tensor]:
    """betas (B, 10), pose (B, 22, 3) and translation (B, 3) of first frames from
    `MeshDistance.arrange`."""
    with torch.inference_mode():
        distance = objective.to(target)
        betas = target.new_zeros(len(target), len(objective.smpl.shapedirs))
        start = rigid_start(objective, objective.shapes(betas), target)
        descending = Descending(descent, betas, *start)
        for _ in range(steps):
            betas, pose, trans = descending.variables
            gradient = distance.gradient(objective.shapes(betas), pose, trans)
            by_betas = distance.betas_gradient(gradient)
            descending.step(gradient.distance, by_betas, gradient.pose, gradient.trans)
            after_step()
    betas, pose, trans = descending.best()
    return betas, pose, trans


class Descending:
    """Gradient descent with momentum on a batch of variables: `torch.optim.SGD`, made lighter.

    Of each body's iterates the one with the smallest distance is kept, the paper's theta*.
    """

    def __init__(self, descent: Descent, *start: Tensor) -> None:
        self.rate = descent.lr
        """Learning rate: the paper's is the same at every step."""
        self._momentum = descent.momentum
        self._shapes = [variable.shape[1:] for variable in start]
        self._state = torch.cat([variable.flatten(1) for variable in start], 1)
        self._velocity = torch.zeros_like(self._state)
        self._best = self._state.clone()
        self._smallest = self._state.new_full((len(self._state),), torch.inf)
        self.variables = self._parts(self._state)

    def step(self, distance: Tensor, *gradients: Tensor) -> Tensor:
        """Go on from where the distance (B,) and its gradients were taken.

        Returns whether each body was closer there than ever before, (B,).
        """
        closer = distance < self._smallest
        self._best = torch.where(closer[:, None], self._state, self._best)
        self._smallest = torch.fmin(distance, self._smallest)
        gradient = torch.cat([gradient.flatten(1) for gradient in gradients], 1)
        self._velocity.mul_(self._momentum).add_(gradient)
        self._state.sub_(self._velocity, alpha=self.rate)
        return closer

    def best(self) -> list[Tensor]:
        """The variables of each body where its distance was smallest."""
        return self._parts(self._best.clone())

    def _parts(self, state: Tensor) -> list[Tensor]:
        parts = state.split([shape.numel() for shape in self._shapes], 1)
        return [part.unflatten(1, shape) for part, shape in zip(parts, self._shapes, strict=True)]


def rigid_start(objective: MeshDistance, shapes: Shapes, target: Tensor) -> tuple[Tensor, Tensor]:
    """Template pose turned and moved onto the meshes: where a first frame's descent begins.

    The paper does not say where its descent begins; from an unturned body it would not find a
    person who looks the other way.
    """
    source, target = objective.restore(shapes.vertices), objective.restore(target)
    centre, target_centre = source.mean(1), target.mean(1)
    turn = nearest_rotation((target - target_centre[:, None]).mT @ (source - centre[:, None]))
    root = shapes.joints[:, 0]
    # The root turns about its own joint: R (x - root) + root + trans.
    trans = target_centre - (turn @ (centre - root)[..., None])[..., 0] - root
    pose = torch.zeros_like(shapes.joints)
    pose[:, 0] = matrix_to_axis_angle(turn)
    return pose, trans
