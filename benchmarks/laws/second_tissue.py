"""A second law of soft tissue, unlike the first in every part: a viscoelastic layer on firm ground.

Each vertex's offset u from its skinned rest position obeys, in the rest frame and per skin area M,

    M (u'' + a w^2 s(e) P u + q) + B (u + t_b u') = M f         the layer, bent over its thickness
    q' = k u' - q / t,      k = r w^2                           a Maxwell element beside the spring

P = I + (p - 1) n n^T makes the layer p times as stiff along the normal n as along the skin, and
s = 1 + b e^2 / (e^2 + e_c^2) with e^2 = u^T P u / h^2, h the layer's thickness, raises its
stiffness from that of fat to that of stretched fibres, 1 + b, and no further. a >= 1 is the tension
of the muscles and changes with time. B = L D M^-1 L, with L the cotangent Laplacian, resists
bending, not stretching. The element and the bending damp: both give up what is fast.

Time is stepped by the diagonally implicit Runge-Kutta method of order 2 that is L-stable
(Alexander 1977, gamma = 1 - 1/sqrt 2). Each of its two stages is a step of implicit Euler, solved
as in projective dynamics: against one constant matrix, the nonlinear force put on the right.
The method is algebraically stable (gamma >= 1/4): as long as the springs are linear, the energy
without load cannot grow in any step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import SuperLU, splu

from bridge.body.surface_operators import cotangent_laplacian, vertex_areas_m2

Array = NDArray[np.floating]

_GAMMA = 1 - np.sqrt(0.5)
# Changes at which iteration ends, relative to the way of a stage and to a settled offset. Each
# iteration shrinks the change many times over, so what is left is far smaller.
_STAGE_TOLERANCE, _SETTLED_TOLERANCE = 1e-3, 1e-9
# Below this change, relative to the offset, there is only rounding.
_ROUNDING = 1e-12
_MOST_ITERATIONS = 1000


@dataclass(frozen=True, eq=False)
class LayerParameters:
    """Mechanics of the layer under V vertices, per unit of mass."""

    frequency_hz: Array
    """(V,) w / 2 pi of a slow and small vibration along the skin, muscles relaxed."""
    thickness_m: Array
    """(V,) h, over which strain is reckoned."""
    normals: Array
    """(V, 3) n, of unit length."""
    relaxation_s: Array
    """(V,) t, after which the Maxwell element has given way."""
    bending_m4_s2: Array
    """(V,) D per mass: resistance to bending."""
    free: NDArray[np.bool_]
    """(V,) False where skin lies on bone and does not move."""
    element_share: float = 0.5
    """r: stiffness of the Maxwell element as a share of the relaxed spring's."""
    normal_ratio: float = 1.8
    """p: stiffness along the normal over that along the skin."""
    fibre_gain: float = 6.0
    """b: how much stiffer than fat stretched fibres are."""
    fibre_strain: float = 1.0
    """e_c: strain at which half of them are stretched."""
    bending_delay_s: float = 0.008
    """t_b: damping of bending."""
    greatest_tension: float = 1.6
    """Most that a becomes."""


@dataclass(frozen=True, eq=False)
class LayerState:
    """Offsets, velocities and the Maxwell elements' forces per mass: (N, 3) of N free vertices."""

    offsets_m: Array
    velocities_m_s: Array
    element_m_s2: Array

    def ahead(self, later: LayerState, share: float) -> LayerState:
        """The state on the line from this to a later one, `share` of the way (or beyond)."""
        return LayerState(
            self.offsets_m + share * (later.offsets_m - self.offsets_m),
            self.velocities_m_s + share * (later.velocities_m_s - self.velocities_m_s),
            self.element_m_s2 + share * (later.element_m_s2 - self.element_m_s2),
        )


class FleshLayer:
    """The layer of one body, stepped at one rate.

    Parameters
    ----------
    vertices : (V, 3) rest shape, metres.
    faces : (F, 3) triangles.
    parameters : mechanics of each vertex.
    rate_hz : steps per second.
    """

    def __init__(
        self,
        vertices: Array,
        faces: NDArray[np.integer],
        parameters: LayerParameters,
        rate_hz: float,
    ) -> None:
        self.parameters, self.dt_s = parameters, 1.0 / rate_hz
        free = self.free = np.flatnonzero(parameters.free)
        areas = vertex_areas_m2(vertices, faces)
        self._mass = areas[free, None]
        self._spring = (2 * np.pi * parameters.frequency_hz[free, None]) ** 2
        self._element = parameters.element_share * self._spring
        self._normals = parameters.normals[free]
        self._thickness = parameters.thickness_m[free, None]
        # All rows and the free columns: a held vertex is clamped, its neighbours bend away from it.
        curvature = cotangent_laplacian(vertices, faces)[:, free]
        self._bending = sp.csr_matrix(
            curvature.T @ sp.diags(parameters.bending_m4_s2 / areas) @ curvature
        )
        eta_s = self._eta_s = _GAMMA * self.dt_s
        decay = 1 + eta_s / parameters.relaxation_s[free, None]
        self._decay, self._strut = decay, self._element / decay
        self._bending_gain = 1 + parameters.bending_delay_s / eta_s
        self._reference = self._stage_reference()
        inertia = 1 / eta_s**2 + self._strut
        self._solver = self._factored(inertia + self._reference, self._bending_gain)

    def at_rest(self) -> LayerState:
        """No offsets, no velocities, relaxed."""
        zeros = np.zeros((len(self.free), 3))
        return LayerState(zeros, zeros, zeros)

    def settled(self, load_m_s2: Array, tension: Array | float = 1.0) -> LayerState:
        """At rest under a constant load (N, 3): M a w^2 s P u + B u = M f, elements relaxed."""
        # Halfway between the least and the greatest stiffness, iteration contracts for certain.
        reference = (self._spring + self._greatest_spring()) / 2
        solver, zeros = self._factored(reference, 1.0), np.zeros_like(load_m_s2)
        offsets_m = self._solve(
            solver, reference, load_m_s2, zeros, tension, _SETTLED_TOLERANCE, zeros
        )
        return LayerState(offsets_m, zeros, zeros)

    def step(
        self, state: LayerState, loads_m_s2: tuple[Array, Array], tension: Array | float = 1.0
    ) -> LayerState:
        """Advance by `dt_s`.

        Both stages and the end are states on lines through what implicit Euler finds:

            Y1 = y + gamma dt Y1',    Y2 = y + (1 - gamma) dt Y1' + gamma dt Y2',    y1 = Y2.

        Parameters
        ----------
        state : at the step's start.
        loads_m_s2 : f (N, 3) at `stage_times` of the step.
        tension : a (N, 1), constant in the step.
        """
        first = self._euler(state, loads_m_s2[0], tension)
        start = state.ahead(first, (1 - _GAMMA) / _GAMMA)
        return self._euler(start, loads_m_s2[1], tension)

    @property
    def stage_times(self) -> tuple[float, float]:
        """When in a step of length 1 each stage asks for its load."""
        return _GAMMA, 1.0

    def energy(self, state: LayerState, tension: Array | float = 1.0) -> float:
        """Kinetic and elastic energy, per unit of surface density.

        The spring's is a w^2 h^2 (e^2 + b (e^2 - e_c^2 ln(1 + e^2 / e_c^2))) / 2, whose gradient
        is a w^2 s P u; the element's is q^2 / 2 k.
        """
        own, u = self.parameters, state.offsets_m
        squared, knee = self._squared_strain(u), own.fibre_strain**2
        fibres = own.fibre_gain * (squared - knee * np.log1p(squared / knee))
        spring = tension * self._spring * self._thickness**2 * (squared + fibres)
        element = state.element_m_s2**2 / self._element
        doubled = self._mass * (spring + (state.velocities_m_s**2 + element).sum(1, keepdims=True))
        return float(doubled.sum() + (u * (self._bending @ u)).sum()) / 2

    def _euler(self, start: LayerState, load_m_s2: Array, tension: Array | float) -> LayerState:
        """Implicit Euler over eta = gamma dt, with v = (u - u0) / eta and q put in:

        M ((u - u0) / eta^2 - v0 / eta + F(u) + (q0 + k (u - u0)) / (1 + eta / t))
            + B (u + t_b (u - u0) / eta) = M f.
        """
        eta_s, u0 = self._eta_s, start.offsets_m
        known = (
            load_m_s2
            + u0 * (1 / eta_s**2 + self._strut)
            + start.velocities_m_s / eta_s
            - start.element_m_s2 / self._decay
            + (self._bending_gain - 1) * (self._bending @ u0) / self._mass
        )
        guess = u0 + eta_s * start.velocities_m_s
        u = self._solve(self._solver, self._reference, known, guess, tension, _STAGE_TOLERANCE, u0)
        element = (start.element_m_s2 + self._element * (u - u0)) / self._decay
        return LayerState(u, (u - u0) / eta_s, element)

    def _solve(
        self,
        solver: SuperLU,
        reference: Array,
        known: Array,
        guess: Array,
        tension: Array | float,
        tolerance: float,
        start: Array,
    ) -> Array:
        """Solve A u + M (F(u) - c u) = M known, A the factored matrix and c its reference spring.

        The change of `u` is compared with its way from `start`.
        """
        u = guess
        for _ in range(_MOST_ITERATIONS):
            force = reference * u - self._spring_force(u, tension)
            before, u = u, solver.solve(self._mass * (known + force))
            way_m = tolerance * np.abs(u - start).max() + _ROUNDING * np.abs(u).max()
            if np.abs(u - before).max() <= way_m:
                break
        return u

    def _stage_reference(self) -> Array:
        """The spring that a stage's matrix holds: a relaxed one, or more for iteration to contract.

        It does where the greatest spring exceeds the reference by less than the inertia does zero.
        """
        relaxed = self._spring * (1 + self.parameters.normal_ratio) / 2
        return np.maximum(relaxed, (self._greatest_spring() - 1 / self._eta_s**2) / 2)

    def _greatest_spring(self) -> Array:
        """Bound of the force's derivative: s + 2 e^2 s' is 1 + 9 b / 8 where it is greatest."""
        own = self.parameters
        fibres = 1 + 9 / 8 * own.fibre_gain
        return own.greatest_tension * own.normal_ratio * fibres * self._spring

    def _spring_force(self, u: Array, tension: Array | float) -> Array:
        """a w^2 s P u, (N, 3), per mass."""
        own = self.parameters
        squared = self._squared_strain(u)
        stiffness = 1 + own.fibre_gain * squared / (squared + own.fibre_strain**2)
        return tension * self._spring * stiffness * self._stretched(u)

    def _stretched(self, u: Array) -> Array:
        """P u."""
        along = np.einsum("vx,vx->v", self._normals, u)[:, None]
        return u + (self.parameters.normal_ratio - 1) * along * self._normals

    def _squared_strain(self, u: Array) -> Array:
        """e^2, (N, 1)."""
        return np.einsum("vx,vx->v", u, self._stretched(u))[:, None] / self._thickness**2

    def _factored(self, diagonal: Array, bending: float) -> SuperLU:
        """M diagonal + bending B."""
        system = sp.csc_matrix(sp.diags((self._mass * diagonal)[:, 0]) + bending * self._bending)
        return splu(system, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
