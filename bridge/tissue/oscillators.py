"""Coupled damped oscillators on the skin, stepped implicitly: the equations of `dsnet_plus`.

A node of skin at x, turned by R, bears per unit of mass the loads of inertia, -R^T x'', and of
gravity, R^T g - g: the scanned shape, upright, already hangs in g, so a body that stands as it was
scanned bears nothing. Place and pose enter only through these, which is why what is learned from
some motions holds for others.

Each node's offset u from its skinned place obeys, in the rest pose's frame,

    u'' + 2 z w u' + w^2 (1 + a |u|_P^2) P u + C u = f,      f = h inertia + j gravity

with P = I + (p - 1) n n^T: skin on firm ground is p times as stiff along its normal n, where flesh
is pressed and pulled, as along itself, where it shears; |u|_P^2 = u^T P u. Neighbours are coupled
by C = c^2 L + D L^2, L the nodes' Laplacian: as a skin under tension and as a plate that resists
bending. One step of dt is Newmark's average acceleration written in three offsets, but for the
load, which is taken at t so that the next offset needs no later pose:

    (u+ - 2 u + u-) / dt^2 + 2 z w (u+ - u-) / (2 dt) + (w^2 P + C) (u+ + 2 u + u-) / 4
        + w^2 a |u|_P^2 P (u+ + u-) / 2 = f_t

Times u+ - u-, the last term on the left is w^2 a / 2 (|u|_P^2 |u+|_P^2 - |u-|_P^2 |u|_P^2): like
the others it is what one step's energy has more than the last one's. So without load the energy

    |u+ - u|^2 / dt^2 / 2 + w^2 |u+ + u|_P^2 / 8 + w^2 a |u+|_P^2 |u|_P^2 / 4 + the coupling's

never grows, however stiff the springs, and a load adds to its root 2^(-1/2) dt |f| a step at most.
That is so where C is symmetric up to the nodes' masses, as with even c and D; that uneven ones ring
out too is tested, not proved.

A step swings a node by 2 atan(w dt / 2) instead of w dt: too slowly, and the more so the stiffer an
impact makes it. A frame is two steps: on violent motion one is not enough (docs/prediction.md).

The matrix on u+ is B + dt^2 C / 4, B each node's own block. With N the sums of dt^2 |C| / 4 over
rows, B + N bounds it from above, and sweeps of Jacobi's kind

    u+ <- (B + N)^-1 (known + (N - dt^2 C / 4) u+)

solve it. Of a mode that has the share s of B + N, (1 - s)^2 is left after two: nothing of a lone
node, and never less than nothing, so no change of velocity is overdone, and what sweeps leave
feeds no vibration.

The step is `bridge.runtime.tissue_graph`; what it is verified by, in float64,
`bridge.verify.reference.oscillators`; what it is trained as, `tf_dsnet.oscillators`.
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

FPS = 60.0
GRAVITY_M_S2 = np.array([0.0, -9.81, 0.0])
STEPS = 2
"""In a frame."""
SWEEPS = 2
"""In a step; they start from u+ = 2 u - u-."""


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

    def __getitem__(self, frames: slice) -> Load:
        return Load(self.inertia[frames], self.gravity[frames])

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
