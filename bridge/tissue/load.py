"""What a moving skeleton and gravity do to the tissue on it, in the frame of the rest pose.

A node of skin at x, turned by R, feels per unit of mass

    inertia  -R^T x''          gravity  R^T g - g

The scanned shape, upright, already hangs in g, so a body that stands as it was scanned feels
nothing. Place and pose enter only through these, which is why what is learned from some motions
holds for others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.smpl import Smpl
from bridge.motion import unpack_theta

GRAVITY_M_S2 = np.array([0.0, -9.81, 0.0])


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
