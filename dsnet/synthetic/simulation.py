"""From a pose sequence to the offsets of soft tissue, and to meshes as a scanner gives them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.posing import Smpl, shaped_vertices
from bridge.motion import unpack_theta
from dsnet.synthetic.motions.plan import GRAVITY_M_S2
from dsnet.synthetic.soft_tissue import RATE_HZ, Array, SoftTissue
from dsnet.synthetic.tissue_parameters import tissue_parameters


class TissueSimulator:
    """The soft tissue of a subject of shape `betas` (10,), from which its mechanics follow.

    With `gravity`, gravity acts on the soft tissue of rotated limbs.
    """

    def __init__(self, body: BodyModelData, betas: Array, *, gravity: bool = True) -> None:
        self._body, self._betas, self._gravity = body, betas, gravity
        vertices = shaped_vertices(body, betas[None])[0]
        self.tissue = SoftTissue(vertices, body.faces, tissue_parameters(body, betas))

    def offsets(self, theta: Array, fps: float) -> NDArray[np.float32]:
        """Offsets (T, V, 3) in the rest pose, metres, of a motion (T, 69).

        It starts in equilibrium in the first pose.
        """
        substeps = round(RATE_HZ / fps)
        if not np.isclose(substeps * fps, RATE_HZ):
            raise ValueError(f"{RATE_HZ} Hz is not a multiple of {fps} fps")
        free, drive = self.tissue.free, self.drive(theta, fps)
        result = np.zeros((len(theta), self._body.vertex_count, 3), np.float32)
        state = self.tissue.settled(drive[0])
        result[0, free] = state.offsets_m
        for frame in range(1, len(theta)):
            before, after = drive[frame - 1], drive[frame]
            for substep in range(substeps):
                fraction = (substep + 0.5) / substeps
                state = self.tissue.step(state, before + fraction * (after - before))
            result[frame, free] = state.offsets_m
        return result

    def drive(self, theta: Array, fps: float) -> Array:
        """R^T (g - x'') - g (T, N, 3), m/s^2, for the N vertices that are free to move.

        This is the load by the skeleton's motion and gravity in the rest frame; without gravity, g
        is 0. A [1 2 1] / 4 filter in time damps impacts, as shoes, foot pads and joints do.
        """
        vertices, turns = skin(self._body, self._betas, theta, self.tissue.free)
        acceleration = np.zeros_like(vertices)
        acceleration[1:-1] = (vertices[2:] - 2 * vertices[1:-1] + vertices[:-2]) * fps**2
        # Equal rows of a matrix product may differ in the last bit, but rest must be exact.
        same = (theta[1:] == theta[:-1]).all(axis=1)
        acceleration[1:-1][same[1:] & same[:-1]] = 0.0
        gravity = np.array([0.0, -GRAVITY_M_S2 if self._gravity else 0.0, 0.0])[:, None]
        drive = np.empty_like(vertices)
        for frame, turn in enumerate(turns):
            drive[frame] = (turn * (gravity - acceleration[frame])[:, None]).sum(0) - gravity
        filtered = drive.copy()
        filtered[1:-1] = (drive[:-2] + 2 * drive[1:-1] + drive[2:]) / 4
        return filtered.transpose(0, 2, 1)


def skin(
    body: BodyModelData, betas: Array, theta: Array, selected: NDArray[np.integer]
) -> tuple[Array, Array]:
    """Vertices (T, 3, N) and each vertex's blended rotation (T, 3, 3, N)."""
    vertices, turns = Smpl(body, selected, np.float64).person(betas).skin(*unpack_theta(theta))
    return vertices.transpose(0, 2, 1), turns.transpose(0, 2, 3, 1)


def posed_meshes(
    body: BodyModelData, betas: Array, theta: Array, offsets_m: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Meshes S_t = M(beta, theta_t) with offsets, posed by Eq. 1-2: (T, V, 3), metres."""
    person = Smpl(body, dtype=np.float64).person(betas)
    return person.pose(*unpack_theta(theta), offsets_m).astype(np.float32)
