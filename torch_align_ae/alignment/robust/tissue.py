"""How soft each vertex is, learned from a subject's own motion by Newton's second law.

The paper's Section 6 admits that a fitted pose swallows part of the jiggling: flesh that swings
looks, to a mesh distance, like a bone that turns. But flesh is only moved by force, and to first
order the force is its displacement times a stiffness. The *observed* acceleration of a vertex,
which needs no pose to be measured, and gravity, which needs a rough one, therefore tell it:

    S_v - x_v(theta) = -sum_k c_vk L_vk + rest of v,        c_vk >= 0,

with x_v the skinned vertex, L_vk the terms of its load (`loads`) and c_vk compliances per unit of
mass; that of the load itself is 1 / omega^2 of a vertex that swings freely. Fitting the pose to
S_v + sum_k c_vk L_vk instead of S_v takes the jiggling out before the pose can swallow it. What
the law leaves unexplained, over time, is the weight of a vertex: bone and firm flesh lead, loose
flesh follows.

Both c_vk and the weights are re-estimated after each step of the pose from nothing but the meshes
(Eq. 5 is not touched: offsets are still taken from S_v itself).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

# Compliances move further than the regression says: it starts from poses that have swallowed
# most of the displacement and approaches the fixed point from one side.
_OVER_RELAXATION = 1.6
# Below any load that would tell something about compliance, (m/s^2)^2 summed over frames.
_NO_LOAD = 1e-6
# Of noisy meshes, the part of the skin that lies on bone: its deviation is every vertex's.
_FIRM = 0.3
# Terms resemble one another: this share of each one's own square keeps them from cancelling.
_RIDGE = 1e-3
_SWEEPS = 60


class Tissue(NamedTuple):
    """Mechanics of the N vertices of a sample, for one subject."""

    compliance_s2: Tensor
    """(K, N) displacement per load, for each of the K terms of `loads`; that of damping in s^3."""
    deviation_m: Tensor
    """(N,) root mean square of what the law does not explain; where meshes are noisy, beyond what
    it does not explain of the firmest vertices."""
    noise_m: Tensor
    """() standard deviation of each coordinate's noise, where it is large; else 0."""

    @classmethod
    def unknown(cls, terms: int, like: Tensor, noise_m: float = 0.0) -> Tissue:
        """No compliance, and all vertices alike: `like` is (..., N)."""
        count = like.shape[-1]
        noise = like.new_tensor(noise_m)
        return cls(like.new_zeros(terms, count), like.new_zeros(count), noise)

    def unloaded(self, vertices: Tensor, terms: Tensor) -> Tensor:
        """Where the vertices (B, 3, N) would be without loads: what the pose is fitted to.

        Parameters
        ----------
        terms : (K, B, 3, N) from `Loads.terms`.
        """
        return vertices + torch.einsum("kn,kbxn->bxn", self.compliance_s2, terms)

    def weights(self, precision_m: float) -> Tensor:
        """(N,) weights of squared distances, 1 for a vertex that the skeleton explains fully.

        `precision_m` is the deviation at which a vertex counts half; noise adds to it.
        """
        half = torch.hypot(self.noise_m.new_tensor(precision_m), self.noise_m)
        return 1 / (1 + (self.deviation_m / half).square())


@dataclass
class Evidence:
    """Sums over frames from which tissue is estimated; frames may come in any portions."""

    gram: Tensor
    """(N, K, K) products of the terms with one another."""
    pull: Tensor
    """(N, K) products of the terms with the displacement, negative."""
    displacement: Tensor
    """(N,) squared."""
    frames: int

    @classmethod
    def of(cls, displacement: Tensor, terms: Tensor) -> Evidence:
        """From displacements from the skinned body (B, 3, N) and terms of loads (K, B, 3, N)."""
        by_vertex = terms.permute(3, 0, 1, 2).flatten(2).double()
        moved = displacement.permute(2, 0, 1).flatten(1).double()
        return cls(
            by_vertex @ by_vertex.mT,
            -(by_vertex @ moved[..., None])[..., 0],
            moved.square().sum(1),
            len(displacement),
        )

    def less_noise(self, in_common: Tensor) -> Evidence:
        """Without the products (K, N) of noise that displacement and terms have in common."""
        return Evidence(self.gram, self.pull - in_common.mT, self.displacement, self.frames)

    def __add__(self, other: Evidence) -> Evidence:
        return Evidence(
            self.gram + other.gram,
            self.pull + other.pull,
            self.displacement + other.displacement,
            self.frames + other.frames,
        )

    def revise(self, tissue: Tissue) -> Tissue:
        """A better estimate than `tissue`, with which the evidence was found.

        For u = displacement and L_k = terms of a vertex, c >= 0 minimises sum |u + c_k L_k|^2;
        what is left of it, as a mean over frames, is the squared deviation. A vertex that is
        never loaded has c = 0. Registrations slide, shiver and fit nowhere exactly, and beside
        that bone and flesh would look alike: where there is noise, what is left of the firmest
        vertices is taken off everywhere.
        """
        regression = _non_negative(self.gram, self.pull).mT.to(tissue.compliance_s2)
        compliance = tissue.compliance_s2
        compliance = (compliance + _OVER_RELAXATION * (regression - compliance)).clamp_min(0)
        c = compliance.mT[..., None].double()
        left = self.displacement - 2 * (c[..., 0] * self.pull).sum(1)
        left = (left + (c.mT @ self.gram @ c)[:, 0, 0]).clamp_min(0)
        if tissue.noise_m > 0:
            left = (left - left.quantile(_FIRM)).clamp_min(0)
        return Tissue(compliance, (left / self.frames).sqrt().to(compliance), tissue.noise_m)


def _non_negative(gram: Tensor, pull: Tensor) -> Tensor:
    """(N, K) the c >= 0 that minimises c^T gram c - 2 c^T pull, by coordinate descent."""
    solution = torch.zeros_like(pull)
    curvature = (1 + _RIDGE) * gram.diagonal(dim1=1, dim2=2)
    for _ in range(_SWEEPS):
        for term in range(pull.shape[1]):
            others = (gram[:, term] * solution).sum(1) - gram[:, term, term] * solution[:, term]
            better = (pull[:, term] - others) / curvature[:, term].clamp_min(_NO_LOAD)
            solution[:, term] = better.clamp_min(0)
    return solution
