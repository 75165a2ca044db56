"""A third tissue law: columns of two masses under the skin, carried through the world.

Under each vertex stand, per area, a muscle mass m1 on the bone and a mass m2 of skin and fat on the
muscle. Their anchors x1, x2 and turning B_t (normal, two tangents) move with the skinned body; with
y = x + B_t u, Newton's law holds in the world, so centrifugal, Coriolis and Euler forces, and those
of an impact, come of themselves:

    m2 y2'' = m2 (g - B_t g_0) - B_t f_fat(u2 - u1) + B_t f_side(u2)
    m1 y1'' = m1 (g - B_t g_0) + B_t f_fat(u2 - u1) - B_t (k1 u1 + c1 u1')

    f_fat(e) = k e phi'(Q) + c (1 + |e'| / v0) e',   Q = e^T k e / (k_t L^2),   k_n pressed > pulled
    f_side(u) = -sigma (u - S u) - n sqrt(kappa) S sqrt(kappa) n^T u,   S = (A + l^2 L)^-1 A

g_0, gravity in the rest pose's column, is the pre-stress of a body scanned upright. phi is Fung's
exponential, beyond Q = 3 its Taylor polynomial of second degree: it stiffens without limit and does
not overflow. S averages over the surface about a length l. Skin resists what differs from the
average (shear); pressure resists a mean pressing, and what is pressed in bulges out around, as in a
nearly incompressible layer. Both are bounded, as 0 <= S <= 1.

Time: BDF2 of 1/240 s in the world; it slows a mode of 5 Hz by 1/200 and one of 20 Hz by 1/12.
Columns are solved implicitly with their whole nonlinearity: for a given stiffening a = phi'(Q) they
are linear, which leaves one monotone equation for log a. What acts sideways is extrapolated: sigma
and kappa together make at most 0.6 of a radian a step. Damping that depends on speed is taken from
the last step's speed, which cannot add energy.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from dsnet.synthetic.motions.plan import GRAVITY_M_S2

Array = NDArray[np.floating]

RATE_HZ = 240.0
# Where the exponential is continued by its polynomial: twenty times as stiff as at rest.
_SAFE_EXPONENT = 3.0
_STIFFENING_STEPS = 4
_SETTLED_M, _MOST_SETTLING_STEPS = 1e-12, 3000


@dataclass(frozen=True, eq=False)
class ThirdTissueParameters:
    """Mechanics of N columns, per area of skin; normal components come first."""

    axes: Array
    """(3, 3, N) normal and two tangents of each column, as matrix columns, in the rest pose."""
    areas_m2: Array
    """(N,) area of skin that a column carries."""
    laplacian: sp.csr_matrix
    """(N, N) cotangent Laplacian of the skin; what it is tied to at its edges is held."""
    skin_kg_m2: Array
    """(N,) outer mass: the skin and half the fat."""
    muscle_kg_m2: Array
    """(N,) inner mass: half the fat and half the muscle."""
    fat_depth_m: Array
    """(N,) from the skin down to the muscle."""
    fat_along_n_m3: Array
    """(N,) stiffness of the fat against shear, per area."""
    fat_pulled_n_m3: Array
    """(N,) stiffness of the fat against being pulled outwards."""
    fat_pressed_n_m3: Array
    """(N,) stiffness of the fat against being pressed inwards."""
    fat_reach_m: Array
    """(N,) L, the sideways stretch at which the fat is e times as stiff as at rest."""
    fat_damping_ns_m3: Array
    """(N,) of slow motion; it doubles at `quadratic_speed_m_s`."""
    muscle_n_m3: Array
    """(3, N) stiffness of the muscle on the bone."""
    muscle_damping_ns_m3: Array
    """(N,) the same at any speed."""
    volume_n_m3: Array
    """(N,) kappa, the resistance to pressing in a whole neighbourhood."""
    shear_n_m3: float
    """sigma, the skin's resistance to moving otherwise than its neighbourhood."""
    neighbourhood_m: float
    """l, the length about which S averages."""
    quadratic_speed_m_s: float
    """v0."""


class ColumnState(NamedTuple):
    """Muscle (0) and skin (1) of all columns, each now and one step before."""

    offsets_m: tuple[Array, Array]
    """(2, 3, N) u, along the axes of each column."""
    places_m: tuple[Array, Array]
    """(2, 3, N) y, in the world."""
    velocities_m_s: tuple[Array, Array]
    """(2, 3, N) y', in the world."""
    log_stiffening: Array
    """(N,) log phi'(Q)."""


class ThirdTissue:
    """The tissue of one body; `gravity` says whether there is any."""

    def __init__(self, parameters: ThirdTissueParameters, *, gravity: bool = True) -> None:
        self.parameters = part = parameters
        self._gravity = np.array([0.0, -GRAVITY_M_S2 if gravity else 0.0, 0.0])[:, None]
        self._masses = np.stack([part.muscle_kg_m2, part.skin_kg_m2])[:, None]
        self._root_volume = np.sqrt(part.volume_n_m3)
        matrix = sp.diags(part.areas_m2) + part.neighbourhood_m**2 * part.laplacian
        options = {"SymmetricMode": True, "DiagPivotThresh": 0.0}
        self._average = splu(sp.csc_matrix(matrix), permc_spec="MMD_AT_PLUS_A", options=options)

    def settled(self, skin_m: Array, turns: Array) -> ColumnState:
        """At rest on anchors that have been still.

        Forward-backward steps: columns implicitly, what acts sideways explicitly, weighed with more
        than half its greatest stiffness, so the energy falls until nothing moves.

        Parameters
        ----------
        skin_m : (3, N) anchors x2 in the world.
        turns : (3, 3, N) B_t, the columns' axes in the world.
        """
        part, load = self.parameters, self._load(turns)
        bound = 0.6 * (part.volume_n_m3 + part.shear_n_m3) + 0.01 * part.fat_along_n_m3
        bound = np.stack([bound, bound])[:, None]
        offsets, log_stiffening = np.zeros((2, *skin_m.shape)), np.zeros(skin_m.shape[1])
        still = np.zeros_like(self._masses)
        for _ in range(_MOST_SETTLING_STEPS):
            force = self._masses * load
            force[1] += self.sideways(offsets[1])
            moved, log_stiffening = self._solve(
                bound, offsets + force / bound, still, offsets, log_stiffening
            )
            change = np.abs(moved - offsets).max(initial=0.0)
            offsets = moved
            if change < _SETTLED_M:
                break
        places, rest = self._places(offsets, skin_m, turns), np.zeros_like(offsets)
        return ColumnState((offsets, offsets), (places, places), (rest, rest), log_stiffening)

    def step(self, state: ColumnState, skin_m: Array, turns: Array) -> ColumnState:
        """The state 1/240 s later, with the anchors (3, N), (3, 3, N) that hold then."""
        part, rate = self.parameters, 1.5 * RATE_HZ
        places, velocities = _from_history(state.places_m), _from_history(state.velocities_m_s)
        coasted = places + velocities / rate
        aims = _into(turns, coasted - self._anchors(skin_m, turns)) + self._load(turns) / rate**2
        now, before = state.offsets_m
        aims[1] += self.sideways(2 * now[1] - before[1]) / (rate**2 * part.skin_kg_m2)
        slip = np.linalg.norm((now - before)[1] - (now - before)[0], axis=0) * RATE_HZ
        fat = part.fat_damping_ns_m3 * (1 + slip / part.quadratic_speed_m_s)
        offsets, log_stiffening = self._solve(
            rate**2 * self._masses,
            aims,
            rate * np.stack([part.muscle_damping_ns_m3, fat])[:, None],
            _from_history(state.offsets_m),
            state.log_stiffening,
        )
        moved = self._places(offsets, skin_m, turns)
        return ColumnState(
            (offsets, now),
            (moved, state.places_m[0]),
            (rate * (moved - places), state.velocities_m_s[0]),
            log_stiffening,
        )

    def potential_j(self, offsets_m: Array) -> float:
        """Elastic energy of offsets (2, 3, N), along the axes of each column."""
        part, (muscle, skin) = self.parameters, offsets_m
        exponent = self._exponent(skin - muscle)
        energy = part.fat_along_n_m3 * part.fat_reach_m**2 * (_fung(exponent) - 1)
        energy += (part.muscle_n_m3 * muscle**2).sum(0) - (skin * self.sideways(skin)).sum(0)
        return float(part.areas_m2 @ energy) / 2

    def kinetic_j(self, velocities_m_s: Array) -> float:
        """Energy of motion of velocities (2, 3, N)."""
        return float((self.parameters.areas_m2 * self._masses * velocities_m_s**2).sum()) / 2

    def sideways(self, skin_m: Array) -> Array:
        """(3, N) f_side, N/m^2, of the skin's offsets, both along the columns' axes."""
        part = self.parameters
        pressed = self._root_volume * skin_m[0]
        fields = np.concatenate([_out_of(part.axes, skin_m), pressed[None]])
        average = self._average.solve((part.areas_m2 * fields).T).T
        force = -part.shear_n_m3 * (skin_m - _into(part.axes, average[:3]))
        force[0] -= self._root_volume * average[3]
        return force

    def _solve(
        self, inertia: Array, aims: Array, drag: Array, before: Array, log_stiffening: Array
    ) -> tuple[Array, Array]:
        """Offsets u (2, 3, N) with inertia (u - aims) + drag (u - before) + f_elastic(u) = 0.

        The drag (2, 1, N) of the fat acts on the difference of skin and muscle.
        """
        part = self.parameters
        hold = inertia[0] + drag[0] + part.muscle_n_m3
        muscle = (inertia[0] * aims[0] + drag[0] * before[0]) / hold
        # Skin and muscle give way by `yielding` to a force between them.
        yielding = 1 / inertia[1] + 1 / hold
        free = aims[1] - muscle + yielding * drag[1] * (before[1] - before[0])
        linear = 1 + yielding * drag[1]
        stiffness = self._stiffness(free)
        stiffening = self._stiffening(free, linear, yielding * stiffness, stiffness, log_stiffening)
        stretch = free / (linear + yielding * stiffness * np.exp(stiffening))
        force = stiffness * np.exp(stiffening) * stretch
        force += drag[1] * (stretch - before[1] + before[0])
        return np.stack([muscle + force / hold, aims[1] - force / inertia[1]]), stiffening

    def _stiffening(
        self, free: Array, linear: Array, compliant: Array, stiffness: Array, guess: Array
    ) -> Array:
        """log a (N,) with a = phi'(Q(free / (linear + compliant a))), by Newton's method.

        The difference of both sides has a slope of 1 or more, so there is one root.
        """
        part, log_a = self.parameters, guess
        share = stiffness / (part.fat_along_n_m3 * part.fat_reach_m**2)
        highest = _log_slope((share * (free / linear) ** 2).sum(0))[0]
        for _ in range(_STIFFENING_STEPS):
            growing = compliant * np.exp(log_a)
            parts = share * (free / (linear + growing)) ** 2
            value, slope = _log_slope(parts.sum(0))
            fall = 2 * (parts * growing / (linear + growing)).sum(0)
            log_a = np.clip(log_a - (log_a - value) / (1 + slope * fall), 0, highest)
        return log_a

    def _stiffness(self, stretch: Array) -> Array:
        """(3, N) of the fat at rest, for stretches of these signs."""
        part = self.parameters
        normal = np.where(stretch[0] > 0, part.fat_pulled_n_m3, part.fat_pressed_n_m3)
        return np.stack([normal, part.fat_along_n_m3, part.fat_along_n_m3])

    def _exponent(self, stretch: Array) -> Array:
        part = self.parameters
        twice = (self._stiffness(stretch) * stretch**2).sum(0)
        return twice / (part.fat_along_n_m3 * part.fat_reach_m**2)

    def _load(self, turns: Array) -> Array:
        """(3, N) gravity less the pre-stress, m/s^2, along the columns' axes."""
        return _into(turns, self._gravity) - _into(self.parameters.axes, self._gravity)

    def _anchors(self, skin_m: Array, turns: Array) -> Array:
        """(2, 3, N) where muscle and skin are when the fat is unstretched."""
        return np.stack([skin_m - turns[:, 0] * self.parameters.fat_depth_m, skin_m])

    def _places(self, offsets: Array, skin_m: Array, turns: Array) -> Array:
        return self._anchors(skin_m, turns) + _out_of(turns, offsets)


def _from_history(values: tuple[Array, Array]) -> Array:
    """What BDF2 takes its rate of change from: value' = 1.5 rate (value - this)."""
    return (4 * values[0] - values[1]) / 3


def _fung(exponent: Array) -> Array:
    """phi(Q): exp Q, continued by its Taylor polynomial of second degree."""
    beyond = np.maximum(exponent - _SAFE_EXPONENT, 0)
    return np.exp(np.minimum(exponent, _SAFE_EXPONENT)) * (1 + beyond + beyond**2 / 2)


def _log_slope(exponent: Array) -> tuple[Array, Array]:
    """Log phi'(Q), and its derivative."""
    beyond = np.maximum(exponent - _SAFE_EXPONENT, 0)
    return np.minimum(exponent, _SAFE_EXPONENT) + np.log1p(beyond), 1 / (1 + beyond)


def _into(axes: Array, vectors: Array) -> Array:
    """Components (..., 3, N) of vectors (..., 3, N) along axes (3, 3, N), the matrix's columns."""
    return (axes * vectors[..., :, None, :]).sum(-3)


def _out_of(axes: Array, components: Array) -> Array:
    """Vectors (..., 3, N) of components (..., 3, N) along axes."""
    return (axes * components[..., None, :, :]).sum(-2)
