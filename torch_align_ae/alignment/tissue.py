"""How soft each vertex is, learned from a subject's own motion by Newton's second law.

The paper's Section 6 admits that a fitted pose swallows part of the jiggling: flesh that swings
looks, to a mesh distance, like a bone that turns. But flesh is only moved by force, and to first
order the force is its displacement times a stiffness. In the limb's frame the tissue under a vertex
carries inertia and the change of gravity since the upright rest pose, in which it already hangs. In
the world's axes, per unit of mass, and with x_v the skinned vertex,

    L = S'' - g + R g,    S_v - x_v(theta) = -sum_k c_vk L_vk + rest of v,    c_vk >= 0,

S'' being the *observed* acceleration, which needs no pose to be measured, g gravity and R the
vertex's blended skinning rotation, which needs a rough one. Four terms take in what a spring alone
leaves out:

    spring      L_1 = L, with c_v1 = 1 / omega^2 of a vertex that swings freely
    stiffening  L_2 = 4 (x(R g) - x(g - S''))    flesh hangs: its springs stiffen about the shape
                                                without weight, x (1 + |2 x / g|^2) = force
    coupling    L_3 = mean of L over the skin around    neighbours pull along
    damping     L_4 = -L'                       the displacement follows its load late

for u'' + 2 z w u' + w^2 u = -L has u = -(L - 2 z / w L' + ...) / w^2 where L is slow. L' is taken
in the world's axes, of S'' alone: what a turning limb adds is of second order.

Fitting the pose to S_v + sum_k c_vk L_vk instead of S_v takes the jiggling out before the pose can
swallow it. What the law leaves unexplained, over time, is the weight of a vertex: bone and firm
flesh lead, loose flesh follows. Both are re-estimated after each step of the pose from nothing but
the meshes (Eq. 5 is not touched: offsets are still taken from S_v itself).
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
# Of flesh that hangs: at this pull its springs are twice as stiff as without weight.
_WEIGHT_M_S2 = 9.81
# Skin pulls its neighbours along within some centimetres.
_REACH_M = 0.06
# Relative weight at which a neighbour is none; far ones would be denormal and slow.
_FAR = 1e-4
# An acceleration looks two frames to either side, its change one more.
_MARGIN = 3
_DIFFERENCES = 4
# Of the absolute value, at unit variance.
_MEDIAN_OF_NORMAL = 0.6745
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


def accelerations(frames: Tensor, fps: float) -> Tensor:
    """Second differences (n, ...) of n frames, per s^2, over two frames to either side.

    (S_t+2 - 2 S_t + S_t-2) / 4 dt^2 has a quarter of the noise of the difference over one frame,
    and flesh hardly moves faster. The frames next to the ends take one frame to either side, the
    ends their neighbour's; fewer than three frames have no acceleration.
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
    """Variance, m^2, of what differs from frame to frame in each coordinate of each vertex.

    Fourth differences, whose noise has 70 times its variance, less their mean over the skin
    around, in which smooth motion is and noise is not. The median forgives what is left of it.
    Fewer than five consecutive frames (n, 3, N) tell nothing; `around` (N, N) weights that mean.
    """
    if len(frames) < _DIFFERENCES + 1:
        return 0.0
    rough = frames.diff(n=_DIFFERENCES, dim=0)
    rough = rough - rough @ around
    return float((rough.abs().median() / _MEDIAN_OF_NORMAL) ** 2) / math.comb(8, 4)


def shared_noise(variance_m2: float, fps: float) -> float:
    """m^2/s^2: expected -(noise . acceleration) of one frame of a vertex, three coordinates.

    The acceleration holds -2 S_t / (2 dt)^2, and so the frame's own noise: a regression would
    take that for softness, of bone too.
    """
    return 3 * 2 * (fps / 2) ** 2 * variance_m2


class Observed(NamedTuple):
    """B frames of the sample of N vertices, with what moves there; needs no pose."""

    vertices: Tensor  # (B, 3, N) metres
    acceleration: Tensor  # (B, 3, N) m/s^2
    around: Tensor  # (B, 3, N) mean acceleration of the skin around each vertex, m/s^2
    jerk: Tensor  # (B, 3, N) m/s^3

    def split(self, frames: int) -> list[Observed]:
        """The same in parts of at most so many frames."""
        return [Observed(*part) for part in zip(*(a.split(frames) for a in self), strict=True)]


class Loads:
    """The terms of the law for a sample; who is whose neighbour is told by the template."""

    # Motion that the terms leave unexplained at which a vertex counts half in the pose.
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
        """Frames of a window: meshes (n, V, 3), metres, and their sample."""
        _, start, stop = window
        first, last = max(start - _MARGIN, 0), min(stop + _MARGIN, window.sequence.length)
        frames = torch.from_numpy(meshes.read(first, last))
        vertices = self.sample.take(frames)
        acceleration = accelerations(vertices, window.sequence.fps)
        rows = torch.arange(start, stop) - first
        after, before = (rows + 1).clamp(max=len(frames) - 1), (rows - 1).clamp(min=0)
        jerk = (acceleration[after] - acceleration[before]) * (window.sequence.fps / 2)
        own = slice(start - first, stop - first)
        acceleration = acceleration[own]
        around = acceleration @ self.around
        return frames[own], Observed(vertices[own], acceleration, around, jerk)

    def terms(self, seen: Observed, turn: Tensor) -> Tensor:
        """(4, B, 3, N) terms of the law; `turn` (B, 22, 3, 3) is the joints' orientation."""
        load = self._with_gravity(seen.acceleration, turn, self.sample.weights)
        pull = GRAVITY_M_S2 * turn[:, :, :, 1].transpose(1, 2) @ self.sample.weights  # -R g
        bent = 4 * (_weightless(load + pull) - _weightless(pull))
        around = self._with_gravity(seen.around, turn, self._weights_around)
        return torch.stack([load, bent, around, -seen.jerk])

    def _with_gravity(self, acceleration: Tensor, turn: Tensor, weights: Tensor) -> Tensor:
        """S'' - g + R g (B, 3, N)."""
        upward = turn[:, :, :, 1].transpose(1, 2) @ weights  # R e_y
        load = acceleration - GRAVITY_M_S2 * upward
        load[:, 1] += GRAVITY_M_S2
        return load

    def noise_in_common(self, terms: Tensor) -> Tensor:
        """(4, N) share of each term in which a vertex's own noise appears as in its acceleration,
        summed over frames. Noise is small beside the loads that bend the term of stiffening.
        """
        frames = terms.shape[1]
        own = terms.new_full((terms.shape[-1],), float(frames))
        load, bent = terms[:2]
        squared = load.square().sum((0, 1)).clamp_min(_NO_LOAD)
        bent = frames * (load * bent).sum((0, 1)) / squared
        return torch.stack([own, bent, frames * self.around.diagonal(), torch.zeros_like(own)])


def _weightless(force: Tensor) -> Tensor:
    """x (B, 3, N) of x (1 + |2 x / g|^2) = force: how far springs give that stiffen by their own
    strain, if they were linear a force (B, 3, N) per unit of mass.
    """
    share = 2 / _WEIGHT_M_S2 * lengths(force).clamp_min(1e-6)
    third = torch.asinh(share * (1.5 * math.sqrt(3))) / 3
    return force * (torch.sinh(third) * (2 / math.sqrt(3)) / share)


class Tissue(NamedTuple):
    """Mechanics of the N vertices of a sample, for one subject."""

    compliance_s2: Tensor  # (K, N) displacement per load, for each of the K terms; damping's in s^3
    # (N,) root mean square of what the law does not explain; where meshes are noisy, beyond what it
    # does not explain of the firmest vertices.
    deviation_m: Tensor
    noise_m: Tensor  # () standard deviation of each coordinate's noise, where it is large; else 0

    @classmethod
    def unknown(cls, terms: int, like: Tensor, noise_m: float = 0.0) -> Tissue:
        """No compliance, and all vertices alike: `like` is (..., N)."""
        count = like.shape[-1]
        noise = like.new_tensor(noise_m)
        return cls(like.new_zeros(terms, count), like.new_zeros(count), noise)

    def unloaded(self, vertices: Tensor, terms: Tensor) -> Tensor:
        """Where the vertices (B, 3, N) would be without loads, whose terms are (K, B, 3, N)."""
        return vertices + torch.einsum("kn,kbxn->bxn", self.compliance_s2, terms)

    def weights(self, precision_m: float) -> Tensor:
        """(N,) weights of squared distances, 1 for a vertex that the skeleton explains fully.

        `precision_m` is the deviation at which a vertex counts half; noise adds to it.
        """
        half = torch.hypot(self.noise_m.new_tensor(precision_m), self.noise_m)
        return 1 / (1 + (self.deviation_m / half).square())


class Evidence(NamedTuple):
    """Sums over frames from which tissue is estimated; frames may come in any portions."""

    gram: Tensor  # (N, K, K) products of the terms with one another
    pull: Tensor  # (N, K) products of the terms with the displacement, negative
    displacement: Tensor  # (N,) squared
    frames: int

    @classmethod
    def of(cls, displacement: Tensor, terms: Tensor, in_common: Tensor | None = None) -> Evidence:
        """From displacements from the skinned body (B, 3, N) and terms of loads (K, B, 3, N).

        Without the products (K, N) of noise that displacement and terms have `in_common`.
        """
        by_vertex = terms.permute(3, 0, 1, 2).flatten(2).double()
        moved = displacement.permute(2, 0, 1).flatten(1).double()
        pull = -(by_vertex @ moved[..., None])[..., 0]
        if in_common is not None:
            pull = pull - in_common.mT
        return cls(by_vertex @ by_vertex.mT, pull, moved.square().sum(1), len(displacement))

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
