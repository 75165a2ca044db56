"""Soft tissue as a damped elastic sheet on the moving skeleton, with stiffening springs.

Each vertex's offset u from its skinned rest position obeys, in the rest frame,

    M (u'' + 2 z w u' + w^2 (1 + a |u|^2) u) + c^2 L u = -M R^T x''

with M the vertex areas, L the surface's cotangent Laplacian, x the skinned vertex and R its
skinning rotation. Gravity is left out: the scanned shape already hangs in it, so stillness means
no offset.

Time is stepped by the implicit midpoint rule with a discrete gradient of the quartic potential.
It adds no damping of its own, and without drive the energy cannot grow, whatever the amplitude.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.linalg import splu

Array = NDArray[np.float64]

RATE_HZ = 240.0
_MAX_ITERATIONS = 30
# Relative change of a step's velocity at which its fixed-point iteration ends.
_TOLERANCE = 1e-4


@dataclass(frozen=True, eq=False)
class TissueParameters:
    """Mechanics of the tissue under V vertices, per unit of skin area."""

    frequency_hz: Array
    """(V,) of a small free vibration of each vertex on its own."""
    damping_ratio: Array
    """(V,) share of critical damping."""
    stiffening_per_m2: Array
    """(V,) a: at an offset u the spring is 1 + a |u|^2 times as stiff as at rest."""
    wave_speed_m_s: float
    """c: speed at which the skin would carry a wave, which couples neighbours."""


@dataclass(frozen=True, eq=False)
class TissueState:
    """Offsets and their velocities, (V, K): K columns are moved alike and independently."""

    offsets_m: Array
    velocities_m_s: Array


class SoftTissue:
    """The tissue of one body; its linear system is factored once.

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
        parameters: TissueParameters,
        rate_hz: float = RATE_HZ,
    ) -> None:
        self.dt_s = 1.0 / rate_hz
        self.mass = vertex_areas_m2(vertices, faces)
        omega = 2 * np.pi * parameters.frequency_hz
        self._damping = self.mass * 2 * parameters.damping_ratio * omega
        coupling = parameters.wave_speed_m_s**2 * cotangent_laplacian(vertices, faces)
        self._stiffness = sp.csr_matrix(sp.diags(self.mass * omega**2) + coupling)
        self._hardening = (self.mass * omega**2 * parameters.stiffening_per_m2)[:, None]
        dt_s = self.dt_s
        system = sp.diags(2 / dt_s * self.mass + self._damping) + dt_s / 2 * self._stiffness
        self._solver = splu(
            system.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}
        )

    def at_rest(self, clip_count: int = 1) -> TissueState:
        """No offsets, no velocities, for `clip_count` clips that are stepped together."""
        zeros = np.zeros((len(self.mass), 3 * clip_count))
        return TissueState(zeros, zeros)

    def step(self, state: TissueState, drive_m_s2: Array) -> TissueState:
        """Advance by `dt_s` under an acceleration (V, K), the mean over the step.

        With v the mean velocity and u0, u1 the offsets before and after, the nonlinear force is
        w^2 a (|u0|^2 + |u1|^2) / 2 (u0 + u1) / 2: its work is exactly the change of the quartic
        potential. It is found by fixed-point iteration on v.
        """
        dt_s, start_m, speed = self.dt_s, state.offsets_m, state.velocities_m_s
        known = self.mass[:, None] * (2 / dt_s * speed + drive_m_s2) - self._stiffness @ start_m
        if not (np.any(known)):
            return state
        squared = _squared_lengths(start_m)
        middle_speed = speed
        for _ in range(_MAX_ITERATIONS):
            stop_m = start_m + dt_s * middle_speed
            strain = (squared + _squared_lengths(stop_m)) / 2
            force = self._hardening * strain * (start_m + stop_m) / 2
            before, middle_speed = middle_speed, self._solver.solve(known - force)
            change = np.abs(middle_speed - before).max()
            if change <= _TOLERANCE * np.abs(middle_speed).max():
                break
        return TissueState(start_m + dt_s * middle_speed, 2 * middle_speed - speed)

    def energy(self, state: TissueState) -> float:
        """Kinetic and elastic energy, per unit of surface density."""
        offsets_m, speed = state.offsets_m, state.velocities_m_s
        kinetic = (self.mass[:, None] * speed**2).sum() / 2
        linear = (offsets_m * (self._stiffness @ offsets_m)).sum() / 2
        fourth = _squared_lengths(offsets_m)[:, ::3] ** 2
        return float(kinetic + linear + (self._hardening * fourth).sum() / 4)


def _squared_lengths(columns: Array) -> Array:
    """Squared length of each vertex's vector, repeated for its three columns."""
    vectors = columns.reshape(len(columns), -1, 3)
    return np.repeat((vectors**2).sum(-1), 3, axis=1)


def vertex_areas_m2(vertices: ArrayLike, faces: NDArray[np.integer]) -> Array:
    """(V,) a third of the area of the triangles around each vertex."""
    corners = np.asarray(vertices)[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1) / 6
    return np.bincount(faces.ravel(), np.repeat(areas, 3), minlength=len(np.asarray(vertices)))


def cotangent_laplacian(vertices: ArrayLike, faces: NDArray[np.integer]) -> sp.csr_matrix:
    """(V, V) positive semi-definite: u^T L u is the Dirichlet energy of u over the surface."""
    vertices = np.asarray(vertices)
    rows, columns, values = [], [], []
    for corner in range(3):
        apex, left, right = (faces[:, (corner + shift) % 3] for shift in range(3))
        to_left, to_right = vertices[left] - vertices[apex], vertices[right] - vertices[apex]
        area = np.linalg.norm(np.cross(to_left, to_right), axis=1)
        rows.append(left)
        columns.append(right)
        values.append((to_left * to_right).sum(1) / np.maximum(area, 1e-12) / 2)
    count = len(vertices)
    indices = (np.concatenate(rows), np.concatenate(columns))
    weights = sp.coo_matrix((np.concatenate(values), indices), shape=(count, count))
    weights = weights + weights.T
    return sp.csr_matrix(sp.diags(np.asarray(weights.sum(1)).ravel()) - weights)
