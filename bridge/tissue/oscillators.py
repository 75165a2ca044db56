"""Coupled damped oscillators on the skin, stepped implicitly: the equations of `dsnet_plus`.

A node of skin at x, turned by R, bears per unit of mass the loads of inertia, -R^T x'', and of
gravity, R^T g - g: the scanned shape, upright, already hangs in g, so a body that stands as it was
scanned bears nothing. Place and pose enter only through these, which is why what is learned from
some motions holds for others.

Flesh that stands hangs by s = (0, -sag, 0) below the shape it would have without weight, and
stiffens about that one: v from there is u + s, u the offset from the skinned place. In the rest
pose's frame

    u'' + 2 Z W u' + w^2 [(1 + a |v|_P^2) P v - (1 + a |s|_P^2) P s] + C u = f,
    f = h inertia + j gravity

with P = I + (p - 1) n n^T: skin on firm ground is p times as stiff along its normal n, where flesh
is pressed and pulled, as along itself, where it shears; |v|_P^2 = v^T P v. W and Z are frequency
and damping of a small vertical vibration at rest, hence w^2 = W^2 / (1 + 3 a |s|_P^2): P makes its
W^2 p times as large along n, hanging or not. Sideways standing flesh is softer, by 1 + a |s|_P^2
over 1 + 3 a |s|_P^2. Neighbours are coupled by C = c^2 L + D L^2, L the nodes' Laplacian: as a
skin under tension and as a plate that resists bending.

In v this is flesh without sag under a load F that is larger by w^2 (1 + a |s|_P^2) P s + C s. One
step of dt is Newmark's average acceleration written in three offsets, but for the load, which is
taken at t so that the next offset needs no later pose:

    (v+ - 2 v + v-) / dt^2 + 2 Z W (v+ - v-) / (2 dt) + (w^2 P + C) (v+ + 2 v + v-) / 4
        + w^2 a |v|_P^2 P (v+ + v-) / 2 = F_t

Times v+ - v-, the last term on the left is w^2 a / 2 (|v|_P^2 |v+|_P^2 - |v-|_P^2 |v|_P^2): like
the others it is what one step's energy has more than the last one's. So without F the energy

    |v+ - v|^2 / dt^2 / 2 + w^2 |v+ + v|_P^2 / 8 + w^2 a |v+|_P^2 |v|_P^2 / 4 + the coupling's

never grows, however stiff the springs, and F adds to its root 2^(-1/2) dt |F| a step at most. That
is so where C is symmetric up to the nodes' masses, as with even c and D; that uneven ones ring out
too is tested, not proved.

The same step in u has no digits to lose where nothing moves: with q = |v|_P^2 - |s|_P^2, which is
(u + 2 s)^T P u, w^2 a |v|_P^2 P (u+ + u-) / 2 + w^2 a q P s stand for the last term, and no load
gives no offset at all.

A step swings a node by 2 atan(w dt / 2) instead of w dt: too slowly, and the more so the stiffer an
impact makes it. A frame is two steps: on violent motion one is not enough.

The matrix on v+ is B + dt^2 C / 4, B each node's own block. With N the sums of dt^2 |C| / 4 over
rows, B + N bounds it from above, and sweeps of Jacobi's kind

    v+ <- (B + N)^-1 (known + (N - dt^2 C / 4) v+)

solve it. Of a mode that has the share s of B + N, (1 - s)^2 is left after two: nothing of a lone
node, and never less than nothing, so no change of velocity is overdone, and what sweeps leave
feeds no vibration.

The step is `dsnet.onnx.tissue_graph`; what it is verified by, in float64,
`dsnet.verify.reference.oscillators`; what it is trained as, `tf_dsnet.oscillators`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.posing import Smpl
from bridge.motion import unpack_theta
from bridge.paper import FPS

GRAVITY_M_S2 = np.array([0.0, -9.81, 0.0])
STEPS = 2
"""In a frame."""
SWEEPS = 2
"""In a step; they start from v+ = 2 v - v-."""


def coupling(coefficients: Mapping[str, NDArray], laplacian: sp.csr_matrix) -> NDArray[np.floating]:
    """(K, K) dt^2 C / 4, of (K, 1) `wave_speed` and `bending`.

    Dense: with few hundred nodes its products are faster than sparse ones, as L^2 fills rows.
    """
    tension, bending = (
        sp.diags(values[:, 0].astype(np.float64))
        for values in (coefficients["wave_speed"] ** 2, coefficients["bending"])
    )
    pulls = tension @ laplacian + bending @ laplacian @ laplacian
    return (pulls / (2 * STEPS * FPS) ** 2).toarray()


@dataclass(frozen=True, eq=False)
class Load:
    """Accelerations (T, K, 3) of K nodes, m/s^2, in the rest pose's frame."""

    inertia: NDArray[np.float32]
    gravity: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.inertia)


def node_loads(
    body: BodyModelData, vertices: NDArray, betas: NDArray, theta: NDArray, fps: float
) -> Load:
    """The loads of a motion theta (T, 69) on nodes at `vertices` (K,) of a body (10,).

    Accelerations are central differences; the first and last frame, which have none, stand still.
    """
    person = Smpl(body, vertices, np.float64).person(betas)
    places, turns = person.skin(*unpack_theta(np.asarray(theta, np.float64)))
    acceleration = np.zeros_like(places)
    acceleration[1:-1] = (places[2:] - 2 * places[1:-1] + places[:-2]) * fps**2
    # R^T w is w^T R: no transposed copies.
    inertia = -np.einsum("tkx,tkxy->tky", acceleration, turns)
    gravity = np.einsum("x,tkxy->tky", GRAVITY_M_S2, turns) - GRAVITY_M_S2
    return Load(inertia.astype(np.float32), gravity.astype(np.float32))
