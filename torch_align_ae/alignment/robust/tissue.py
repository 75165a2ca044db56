"""How soft each vertex is, learned from a subject's own motion by Newton's second law.

The paper's Section 6 admits that a fitted pose swallows part of the jiggling: flesh that swings
looks, to a mesh distance, like a bone that turns. But flesh is only moved by force, and to first
order the force is its displacement times a stiffness. The *observed* acceleration of a vertex,
which needs no pose to be measured, therefore tells its displacement:

    S_v - x_v(theta) = -c_v S_v'' + rest of v,        c_v >= 0 in s^2,

with x_v the skinned vertex and c_v the compliance per unit of mass, 1 / omega^2 of a vertex that
swings freely. Fitting the pose to S_v + c_v S_v'' instead of S_v takes the jiggling out before
the pose can swallow it. What this law leaves unexplained, over time, is the weight of a vertex:
bone and firm flesh lead, loose flesh follows.

Both c_v and the weights are re-estimated after each step of the pose from nothing but the meshes
(Eq. 5 is not touched: offsets are still taken from S_v itself).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

# Compliances move further than the regression says: it starts from poses that have swallowed
# most of the displacement and approaches the fixed point from one side.
_OVER_RELAXATION = 1.6
# Below any acceleration that would tell something about compliance, (m/s^2)^2 summed over frames.
_NO_MOTION = 1e-6


@dataclass(frozen=True)
class Tissue:
    """Mechanics of the N vertices of a sample, for one subject."""

    compliance_s2: Tensor
    """(N,) displacement per acceleration of the observed vertex."""
    deviation_m: Tensor
    """(N,) root mean square of what the compliance does not explain."""

    @classmethod
    def unknown(cls, like: Tensor) -> Tissue:
        """No compliance, and all vertices alike: `like` is (..., N)."""
        return cls(like.new_zeros(like.shape[-1]), like.new_zeros(like.shape[-1]))

    def target(self, vertices: Tensor, acceleration: Tensor) -> Tensor:
        """Where the vertices (B, 3, N) would be without inertia: what the pose is fitted to."""
        return torch.addcmul(vertices, acceleration, self.compliance_s2)

    def weights(self, precision_m: float) -> Tensor:
        """(N,) weights of squared distances, 1 for a vertex that the skeleton explains fully.

        `precision_m` is the deviation at which a vertex counts half.
        """
        return 1 / (1 + (self.deviation_m / precision_m).square())


@dataclass
class Evidence:
    """Sums over frames from which tissue is estimated; frames may come in any portions."""

    displacement_drive: Tensor
    drive: Tensor
    displacement: Tensor
    frames: int

    @classmethod
    def of(cls, displacement: Tensor, acceleration: Tensor) -> Evidence:
        """From displacements from the skinned body and accelerations, both (B, 3, N)."""
        return cls(
            -(displacement * acceleration).sum((0, 1)),
            acceleration.square().sum((0, 1)),
            displacement.square().sum((0, 1)),
            len(displacement),
        )

    def __add__(self, other: Evidence) -> Evidence:
        return Evidence(
            self.displacement_drive + other.displacement_drive,
            self.drive + other.drive,
            self.displacement + other.displacement,
            self.frames + other.frames,
        )

    def revise(self, tissue: Tissue) -> Tissue:
        """A better estimate than `tissue`, with which the evidence was found.

        For u = displacement and a = acceleration of a vertex, c = -sum(u . a) / sum(a . a)
        minimises sum |u + c a|^2, of which sum |u|^2 + 2 c sum(u . a) + c^2 sum |a|^2 is left; its
        mean over frames is the squared deviation. A vertex that never accelerates has c = 0.
        """
        regression = self.displacement_drive / self.drive.clamp_min(_NO_MOTION)
        compliance = tissue.compliance_s2
        compliance = (compliance + _OVER_RELAXATION * (regression - compliance)).clamp_min(0)
        left = self.displacement - 2 * compliance * self.displacement_drive
        left = (left + compliance.square() * self.drive).clamp_min(0)
        return Tissue(compliance, (left / self.frames).sqrt())
