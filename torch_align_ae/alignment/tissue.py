"""How soft each vertex is, estimated from a subject's motion by Newton's second law.

As the paper's Section 6 says, a fitted pose absorbs part of the dynamics: to a mesh distance,
swinging tissue looks like a rotating bone. But tissue is moved by forces, and to first order the
force is its displacement times a stiffness. In the limb's frame the forces on the tissue under a
vertex are inertia and the change of gravity since the upright rest pose, in which it already sags.
In the world's axes, per unit of mass, and with x_v the skinned vertex,

    L = S'' - g + R g,    S_v - x_v(theta) = -sum_k c_vk L_vk + rest of v,    c_vk >= 0,

S'' being the *observed* acceleration, which needs no pose to be measured, g gravity and R the
vertex's blended skinning rotation, which needs a rough one. Four terms describe more than a linear
spring:

    spring      L_1 = L, with c_v1 = 1 / omega^2 of a vertex that swings freely
    stiffening  L_2 = 4 (x(R g) - x(g - S''))    springs stiffen about the weightless shape,
                                                x (1 + |2 x / g|^2) = force
    coupling    L_3 = mean of L over the skin around    neighbours pull one another
    damping     L_4 = -L'                       the displacement lags behind its load

for u'' + 2 z w u' + w^2 u = -L has u = -(L - 2 z / w L' + ...) / w^2 where L is slow. L' is taken
in the world's axes, of S'' alone: the rotation of the limb adds a term of second order.

Fitting the pose to S_v + sum_k c_vk L_vk instead of S_v removes the dynamics before the pose can
absorb them. The weight of a vertex follows from the displacements that the law does not explain:
bone and firm tissue have large weights, loose tissue has small ones. Both are estimated again after
each step of the pose, from the meshes alone (Eq. 5 is not changed: offsets are still those of S_v).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from torch_align_ae.alignment.corpus_fit import Meshes, Window
from torch_align_ae.alignment.skin_sample import SkinSample
from torch_align_ae.body.smpl import lengths

GRAVITY_M_S2 = 9.81
# Under this load springs are twice as stiff as without weight.
_WEIGHT_M_S2 = 9.81
# Distance over which skin is coupled to its neighbours.
_REACH_M = 0.06
# Relative weight of neighbours that are neglected, as denormal numbers are slow.
_FAR = 1e-4
# An acceleration needs two frames on either side, its derivative one more.
_MARGIN = 3
_DIFFERENCES = 4
# Of the absolute value, at unit variance.
_MEDIAN_OF_NORMAL = 0.6745
# Compliances change by more than the regression gives: as the first poses absorb most of the
# displacement, it approaches the fixed point from one side.
_OVER_RELAXATION = 1.6
# Smaller than any load by which compliance can be estimated, (m/s^2)^2 summed over frames.
_NO_LOAD = 1e-6
# In noisy meshes, the share of vertices on bone, whose deviation is taken to be noise.
_FIRM = 0.3
# Relative ridge, as terms are correlated and would otherwise cancel.
_RIDGE = 1e-3
_SWEEPS = 60


def accelerations(frames: Tensor, fps: float) -> Tensor:
    """Second differences (n, ...) of n frames, per s^2, over two frames to either side.

    (S_t+2 - 2 S_t + S_t-2) / 4 dt^2 has a quarter of the noise of the difference over one frame,
    and soft tissue hardly moves faster. Frames next to the ends use one frame on either side, the
    ends have their neighbour's acceleration; it is 0 for fewer than three frames.
    """
    result = torch.zeros_like(frames)
    for step in (1, 2):
        if len(frames) > 2 * step:
            middle = frames[step:-step]
            inner = (frames[2 * step :] - 2 * middle + frames[: -2 * step]) * (fps / step) ** 2
            result[step:-step] = inner
    result[0], result[-1] = result[1:2].sum(0), result[-2:-1].sum(0)
    return result


def noise_variance(frames: Tensor, around: Tensor) -> float:
    """Variance, m^2, of the noise of each coordinate of a vertex in frames (n, 3, N).

    It is estimated by fourth differences, which have 70 times the variance, less their mean over
    the skin around, which contains smooth motion but no noise. The median is robust to the rest of
    the motion. It is 0 for fewer than five frames; `around` (N, N) weights that mean.
    """
    if len(frames) < _DIFFERENCES + 1:
        return 0.0
    rough = frames.diff(n=_DIFFERENCES, dim=0)
    rough = rough - rough @ around
    return float((rough.abs().median() / _MEDIAN_OF_NORMAL) ** 2) / math.comb(8, 4)


def shared_noise(variance_m2: float, fps: float) -> float:
    """m^2/s^2: expected -(noise . acceleration) of one frame of a vertex, three coordinates.

    The acceleration contains -2 S_t / (2 dt)^2, and so the noise of the frame itself, which a
    regression would interpret as softness.
    """
    return 3 * 2 * (fps / 2) ** 2 * variance_m2


class Observed(NamedTuple):
    """B frames of the sample of N vertices, with accelerations, which need no pose."""

    vertices: Tensor  # (B, 3, N) metres
    acceleration: Tensor  # (B, 3, N) m/s^2
    around: Tensor  # (B, 3, N) mean acceleration of the skin around each vertex, m/s^2
    jerk: Tensor  # (B, 3, N) m/s^3

    def split(self, frames: int) -> list[Observed]:
        """Split into parts of at most `frames` frames."""
        return [Observed(*part) for part in zip(*(a.split(frames) for a in self), strict=True)]


class Loads:
    """The terms of the law for a sample; neighbours are determined on the template."""

    # Unexplained displacement at which a vertex has half the weight.
    precision_m = 1e-4

    def __init__(self, sample: SkinSample) -> None:
        self.sample = sample
        places = sample.smpl.template[:, sample.vertices].T
        near = torch.exp(-torch.cdist(places, places).square() / (2 * _REACH_M**2))
        near[near < _FAR] = 0
        # (N, N) weights of the mean over the skin around: column v is vertex v's.
        self.around = near / near.sum(0)
        self._weights_around = sample.weights @ self.around

    def observe(self, meshes: Meshes, window: Window) -> tuple[Tensor, Observed]:
        """Read the meshes (n, V, 3), metres, of a window, and observe their sample."""
        _, start, stop = window
        first, last = max(start - _MARGIN, 0), min(stop + _MARGIN, window.sequence.length)
        frames = torch.from_numpy(meshes.read(first, last))
        vertices = self.sample.select(frames)
        acceleration = accelerations(vertices, window.sequence.fps)
        rows = torch.arange(start, stop) - first
        after, before = (rows + 1).clamp(max=len(frames) - 1), (rows - 1).clamp(min=0)
        jerk = (acceleration[after] - acceleration[before]) * (window.sequence.fps / 2)
        inside = slice(start - first, stop - first)
        acceleration = acceleration[inside]
        around = acceleration @ self.around
        return frames[inside], Observed(vertices[inside], acceleration, around, jerk)

    def terms(self, seen: Observed, turn: Tensor) -> Tensor:
        """Terms (4, B, 3, N) of the law; `turn` (B, 22, 3, 3) are orientations of the joints."""
        load = self._with_gravity(seen.acceleration, turn, self.sample.weights)
        pull = GRAVITY_M_S2 * turn[:, :, :, 1].transpose(1, 2) @ self.sample.weights  # -R g
        stiffening = 4 * (_weightless(load + pull) - _weightless(pull))
        around = self._with_gravity(seen.around, turn, self._weights_around)
        return torch.stack([load, stiffening, around, -seen.jerk])

    def _with_gravity(self, acceleration: Tensor, turn: Tensor, weights: Tensor) -> Tensor:
        """S'' - g + R g (B, 3, N)."""
        upward = turn[:, :, :, 1].transpose(1, 2) @ weights  # R e_y
        load = acceleration - GRAVITY_M_S2 * upward
        load[:, 1] += GRAVITY_M_S2
        return load

    def noise_in_common(self, terms: Tensor) -> Tensor:
        """Shares (4, N), summed over frames, of a vertex's noise in each term.

        A share is 1 if the noise appears as in the acceleration. In the nonlinear term of
        stiffening noise is taken to be small compared with loads.
        """
        frames = terms.shape[1]
        direct = terms.new_full((terms.shape[-1],), float(frames))
        load, stiffening = terms[:2]
        squared = load.square().sum((0, 1)).clamp_min(_NO_LOAD)
        stiffening = frames * (load * stiffening).sum((0, 1)) / squared
        around = frames * self.around.diagonal()
        return torch.stack([direct, stiffening, around, torch.zeros_like(direct)])


def _weightless(force: Tensor) -> Tensor:
    """The solution x (B, 3, N) of x (1 + |2 x / g|^2) = force (B, 3, N) per unit of mass.

    It is the displacement of springs that stiffen with their strain.
    """
    share = 2 / _WEIGHT_M_S2 * lengths(force).clamp_min(1e-6)
    third = torch.asinh(share * (1.5 * math.sqrt(3))) / 3
    return force * (torch.sinh(third) * (2 / math.sqrt(3)) / share)


class Tissue(NamedTuple):
    """Mechanics of the N vertices of a sample, for one subject."""

    compliance_s2: Tensor  # (K, N) displacement per load, for each of the K terms; damping's in s^3
    # (N,) root mean square of the unexplained displacement; in noisy meshes, beyond that of the
    # firmest vertices.
    deviation_m: Tensor
    noise_m: Tensor  # () standard deviation of each coordinate's noise if it is large; else 0

    @classmethod
    def rigid(cls, terms: int, like: Tensor, noise_m: float = 0.0) -> Tissue:
        """No compliance and no deviation; `like` (..., N) gives shape and type."""
        count = like.shape[-1]
        noise = like.new_tensor(noise_m)
        return cls(like.new_zeros(terms, count), like.new_zeros(count), noise)

    def unloaded(self, vertices: Tensor, terms: Tensor) -> Tensor:
        """Vertices (B, 3, N) without the displacement by loads with terms (K, B, 3, N)."""
        return vertices + torch.einsum("kn,kbxn->bxn", self.compliance_s2, terms)

    def weights(self, precision_m: float) -> Tensor:
        """(N,) weights of squared distances, 1 for a vertex that the skeleton explains fully.

        `precision_m` is the deviation at which a vertex counts half; noise adds to it.
        """
        half = torch.hypot(self.noise_m.new_tensor(precision_m), self.noise_m)
        return 1 / (1 + (self.deviation_m / half).square())


class Evidence(NamedTuple):
    """Sums over frames from which tissue is estimated; those of parts can be added."""

    gram: Tensor  # (N, K, K) products of the terms with one another
    pull: Tensor  # (N, K) products of the terms with the displacement, negative
    displacement: Tensor  # (N,) squared
    frames: int

    @classmethod
    def of(cls, displacement: Tensor, terms: Tensor, in_common: Tensor | None = None) -> Evidence:
        """Sums of displacements from the skinned body (B, 3, N) and terms of loads (K, B, 3, N).

        Products (K, N) of the noise that displacement and terms have `in_common` are subtracted.
        """
        by_vertex = terms.permute(3, 0, 1, 2).flatten(2).double()
        moved = displacement.permute(2, 0, 1).flatten(1).double()
        pull = -(by_vertex @ moved[..., None])[..., 0]
        if in_common is not None:
            pull = pull - in_common.mT
        return cls(by_vertex @ by_vertex.mT, pull, moved.square().sum(1), len(displacement))

    def revise(self, tissue: Tissue) -> Tissue:
        """A better estimate than `tissue`, by which the poses of this evidence were fitted.

        For u = displacement and L_k = terms of a vertex, c >= 0 minimises sum |u + c_k L_k|^2;
        the mean of the residual over frames is the squared deviation. A vertex without loads has
        c = 0. Registered meshes slide and are noisy, beside which bone and soft tissue would look
        alike: in noisy meshes the residual of the firmest vertices is subtracted everywhere.
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
