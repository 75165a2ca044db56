"""Soft tissue as a damped elastic surface on the moving skeleton, with springs under preload.

In the scanned upright shape tissue already sags by gravity g: it is displaced by s = (0, -sag, 0)
from its weightless shape, about which springs stiffen. Each vertex's offset u from its skinned rest
position obeys, in the rest frame and with v = u + s,

    M (u'' + 2 Z W u' + w^2 ((1 + a |v|^2) v - (1 + a |s|^2) s)) + c^2 L u = M (R^T (g - x'') - g)

with M the vertex areas, L the surface's cotangent Laplacian, x the skinned vertex and R its
skinning rotation. In the upright rest pose u is 0; in free fall springs soften, in a landing they
stiffen; on a rotated limb the change of g in its frame is a load.

What can be measured on a standing person is the small vertical vibration, of angular frequency
W = w sqrt(1 + 3 a |s|^2) and damping ratio Z. With the preload t = sag W^2 / g, which is 1 for a
linear spring and 2 for one of half the frequency without weight, and w^2 (1 + a |s|^2) |s| = g, the
springs' force is

    g / sag (u + b e (u + s)),    e = |v|^2 - |s|^2 = |u|^2 + 2 s.u,    b = (t - 1) / (2 sag^2)

which is exactly 0 at u = 0, and for lateral displacements that of a pendulum.

Time is stepped by the implicit midpoint rule with a discrete gradient of the quartic potential.
It adds no numerical damping, and without drive the energy cannot grow at any amplitude.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from bridge.body.surface_operators import cotangent_laplacian, vertex_areas_m2
from dsnet.synthetic.motions.plan import GRAVITY_M_S2

Array = NDArray[np.floating]

RATE_HZ = 240.0
_STIFF_ITERATIONS = 100
_SYMMETRIC: dict[str, Any] = {"permc_spec": "MMD_AT_PLUS_A", "options": {"SymmetricMode": True}}
# Relative change of a step's velocity at which its fixed-point iteration ends. Each iteration
# reduces the change fifty-fold or more, so the error is far smaller.
_TOLERANCE = 1e-4


@dataclass(frozen=True, eq=False)
class TissueParameters:
    """Mechanics of the tissue under V vertices, per unit of skin area."""

    frequency_hz: Array  # (V,) of a small vertical vibration, standing, of each vertex on its own
    damping_ratio: Array  # (V,) of that vibration
    preload: float  # t, from 1 to below 3: sag relative to linear springs of these frequencies
    wave_speed_m_s: float  # c: speed of waves along the skin, by which neighbours are coupled
    free: NDArray[np.bool_]  # (V,) False where skin lies on bone and does not move


@dataclass(frozen=True, eq=False)
class TissueState:
    """Offsets and their velocities, (N, 3), of the N vertices that are free to move."""

    offsets_m: Array
    velocities_m_s: Array
    last_change_m_s: Array
    """Change of velocity over the second half of the last step, to guess the next one."""


class SoftTissue:
    """The tissue of one body (V, 3), in metres and triangles (F, 3), at `rate_hz` steps a second.

    Its linear system is factored once.
    """

    def __init__(
        self,
        vertices: Array,
        faces: NDArray[np.integer],
        parameters: TissueParameters,
        rate_hz: float = RATE_HZ,
    ) -> None:
        self.dt_s = dt_s = 1.0 / rate_hz
        self.free = np.flatnonzero(parameters.free)
        self._mass = vertex_areas_m2(vertices, faces)[self.free, None]
        omega = 2 * np.pi * parameters.frequency_hz[self.free, None]
        preload = parameters.preload
        sag_m = preload * GRAVITY_M_S2 / omega**2
        self._sag_m = np.hstack([0 * sag_m, -sag_m, 0 * sag_m])  # s
        spring = self._mass * omega**2 / preload
        damping = self._mass * 2 * parameters.damping_ratio[self.free, None] * omega
        laplacian = cotangent_laplacian(vertices, faces)[self.free][:, self.free]
        coupling = parameters.wave_speed_m_s**2 * laplacian
        self._stiffness = sp.csr_matrix(sp.diags(spring[:, 0]) + coupling)
        self._hardening = spring * (preload - 1) / (2 * sag_m**2)
        diagonal = (2 / dt_s * self._mass + damping)[:, 0]
        self._system = sp.csc_matrix(sp.diags(diagonal) + dt_s / 2 * self._stiffness)
        self._solver = splu(self._system, **_SYMMETRIC)
        self._softening = dt_s / 2 * self._hardening / self._system.diagonal()[:, None]

    def settled(self, drive_m_s2: Array) -> TissueState:
        """Equilibrium under a constant acceleration (N, 3): K u + H e (u + s) = M drive."""
        zeros = np.zeros((len(self.free), 3))
        pull = self._mass * drive_m_s2
        offsets_m = self._balanced(self._stiffness, 1.0, pull, self._sag_m, self._strain, zeros)
        return TissueState(offsets_m, zeros, zeros)

    def _balanced(
        self,
        system: sp.spmatrix,
        factor: float,
        right: Array,
        shift_m: Array,
        strain_of: Callable[[Array], Array],
        guess: Array,
    ) -> Array:
        """The solution x (N, 3) of system x + H e (factor x + shift) = right.

        It is slow, as the stiffening springs are part of the matrix. The strain e depends on x; it
        is changed by half of the difference in each iteration, as full steps would overshoot. At a
        fixed e the system is never softer than the weightless springs.
        """
        solution, strain = guess, strain_of(guess)
        for _ in range(_STIFF_ITERATIONS):
            spring = self._hardening * strain
            solver = splu(sp.csc_matrix(system + sp.diags(factor * spring[:, 0])), **_SYMMETRIC)
            before, solution = solution, solver.solve(right - spring * shift_m)
            if np.abs(solution - before).max() <= _TOLERANCE**2 * np.abs(solution).max():
                break
            strain = (strain + strain_of(solution)) / 2
        return solution

    def step(self, state: TissueState, drive_m_s2: Array) -> TissueState:
        """Advance by `dt_s` under an acceleration (N, 3) of the free vertices, the step's mean.

        With v the mean velocity, D the damping and K the linear stiffness, the midpoint rule

            M (2/dt (v - v0)) + D v + K (u0 + dt/2 v) + N(u0, u1) = M drive,    u1 = u0 + dt v

        has v's terms on the left, (2/dt M + D + dt/2 K) v, and `right` on the right. The nonlinear
        force N is H (e0 + e1) / 2 (s + (u0 + u1) / 2), H = M g / sag b: its work N (u1 - u0) is
        exactly the change of the quartic potential H e^2 / 4.
        """
        dt_s, start_m, speed = self.dt_s, state.offsets_m, state.velocities_m_s
        right = self._mass * (2 / dt_s * speed + drive_m_s2) - self._stiffness @ start_m
        guess = speed + state.last_change_m_s
        middle_speed = self._contract(right, start_m, guess)
        if middle_speed is None:  # very large loads
            e0, shift_m = self._strain(start_m), self._sag_m + start_m

            def mean_strain(speed: Array) -> Array:
                return (e0 + self._strain(start_m + dt_s * speed)) / 2

            middle_speed = self._balanced(
                self._system, dt_s / 2, right, shift_m, mean_strain, guess
            )
        return TissueState(
            start_m + dt_s * middle_speed, 2 * middle_speed - speed, middle_speed - speed
        )

    def _contract(self, right: Array, start_m: Array, middle_speed: Array) -> Array | None:
        """Quasi-Newton iteration with the factored system; None when it does not converge fast.

        N(u0, u1) is evaluated at the latest v and put on the right, so the factored matrix can be
        used. The derivative of N by v, H (e dt / 2 + dt m m^T) with m the middle of the step, then
        reduces each vertex's change as if it had no neighbours, as springs outweigh the coupling.
        """
        before_step, last_change = self._strain(start_m), np.inf
        while True:
            middle_m = self._sag_m + start_m + self.dt_s / 2 * middle_speed
            strain = (before_step + self._strain(start_m + self.dt_s * middle_speed)) / 2
            step = self._solver.solve(right - self._hardening * strain * middle_m) - middle_speed
            even = 1 + self._softening * strain
            along = 2 * self._softening * _dot(middle_m, step)
            along /= even + 2 * self._softening * _dot(middle_m, middle_m)
            step = (step - along * middle_m) / even
            middle_speed = middle_speed + step
            change = np.abs(step).max()
            if change <= _TOLERANCE * np.abs(middle_speed).max():
                return middle_speed
            if change > last_change / 2:
                return None
            last_change = change

    def _strain(self, offsets_m: Array) -> Array:
        """(N, 1) e = |u|^2 + 2 s.u, square metres: exactly 0 at rest."""
        return _dot(offsets_m, offsets_m + 2 * self._sag_m)


def _dot(one: Array, other: Array) -> Array:
    return np.einsum("vx,vx->v", one, other)[:, None]
