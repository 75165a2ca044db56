"""What loads the tissue of each vertex, read from the meshes and, for gravity, from the pose.

In the limb's frame the tissue under a vertex carries inertia and the change of gravity since the
upright rest pose, in which it already hangs. In the world's axes, per unit of mass,

    L = S'' - g + R g,

with S'' the *observed* acceleration, g gravity and R the vertex's blended skinning rotation. To
first order the displacement is u = -c L. Four terms of a law, each with a coefficient a vertex
that is not negative, u = -sum_k c_k L_k, take in what a spring alone leaves out:

    spring      L_1 = L
    stiffening  L_2 = L / (1 + |L|^2 / L0^2)    small loads move more than their share
    coupling    L_3 = mean of L over the skin around    neighbours pull along
    damping     L_4 = -L'                       the displacement follows its load late

for u'' + 2 z w u' + w^2 u = -L has u = -(L - 2 z / w L' + ...) / w^2 where L is slow. L' is taken
in the world's axes, of S'' alone: what a turning limb adds is of second order.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import torch
from torch import Tensor

from torch_align_ae.alignment.robust.recording import MeshRecording
from torch_align_ae.alignment.robust.sample import SkinSample

GRAVITY_M_S2 = 9.81
# About a load of twice gravity the stiffening term bends; the other terms are linear throughout.
_BEND_M_S2 = 20.0
# Skin pulls its neighbours along within some centimetres.
_REACH_M = 0.06
# Relative weight at which a neighbour is none; far ones would be denormal and slow.
_FAR = 1e-4


class Observed(NamedTuple):
    """B frames of the sample of N vertices, with what moves there; needs no pose."""

    vertices: Tensor
    """(B, 3, N) metres."""
    acceleration: Tensor
    """(B, 3, N) m/s^2."""
    around: Tensor
    """(B, 3, N) mean acceleration of the skin around each vertex, m/s^2."""
    jerk: Tensor
    """(B, 3, N) m/s^3."""

    def split(self, frames: int) -> list[Observed]:
        """The same in parts of at most so many frames."""
        return [Observed(*part) for part in zip(*(a.split(frames) for a in self), strict=True)]


@dataclass(frozen=True)
class Loads:
    """The terms of the law for a sample."""

    precision_m: ClassVar[float] = 1e-4
    """Metres of motion that the terms leave unexplained at which a vertex counts half in the
    pose."""
    sample: SkinSample
    around: Tensor
    """(N, N) weights of the mean over the skin around: column v is vertex v's."""
    weights_around: Tensor
    """(22, N) that mean of the skinning weights."""

    @classmethod
    def of(cls, sample: SkinSample) -> Loads:
        """For a sample; who is whose neighbour is told by the template."""
        places = sample.smpl.template[:, sample.vertices].T
        near = torch.exp(-torch.cdist(places, places).square() / (2 * _REACH_M**2))
        near[near < _FAR] = 0
        around = near / near.sum(0)
        return cls(sample, around, sample.weights @ around)

    def observe(self, recording: MeshRecording, start: int, stop: int) -> tuple[Tensor, Observed]:
        """Frames [start, stop) of a recording: meshes (n, V, 3), metres, and their sample."""
        meshes, vertices, acceleration, jerk = recording.moving(start, stop, self.sample.take)
        return meshes, Observed(vertices, acceleration, acceleration @ self.around, jerk)

    def terms(self, seen: Observed, turn: Tensor) -> Tensor:
        """(4, B, 3, N) terms of the law.

        Parameters
        ----------
        turn : (B, 22, 3, 3) orientation of the joints, `Frames.turn`.
        """
        load = self._with_gravity(seen.acceleration, turn, self.sample.weights)
        bent = load / (1 + load.square().sum(1, keepdim=True) / _BEND_M_S2**2)
        around = self._with_gravity(seen.around, turn, self.weights_around)
        return torch.stack([load, bent, around, -seen.jerk])

    def _with_gravity(self, acceleration: Tensor, turn: Tensor, weights: Tensor) -> Tensor:
        """S'' - g + R g (B, 3, N)."""
        upward = turn[:, :, :, 1].transpose(1, 2) @ weights  # R e_y
        load = acceleration - GRAVITY_M_S2 * upward
        load[:, 1] += GRAVITY_M_S2
        return load

    def noise_in_common(self, terms: Tensor) -> Tensor:
        """(4, N) share of each term in which a vertex's own noise appears as in its acceleration.

        Summed over frames. The derivative of the bend of stiffening is passed over: noise is small
        beside the loads that bend it.
        """
        frames = terms.shape[1]
        own = terms.new_full((terms.shape[-1],), float(frames))
        bent = (1 / (1 + terms[0].square().sum(1) / _BEND_M_S2**2)).sum(0)
        return torch.stack([own, bent, frames * self.around.diagonal(), torch.zeros_like(own)])
