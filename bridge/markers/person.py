"""The shape of a body model that the person has whom a file's markers were on.

A file's betas are of another body model's shapes; the markers say where the skin was. Each keeps
the vertex that it stays nearest to, and the betas are those that, with a shift of the whole motion,
bring the skin to them in the file's pose. Turns of joints beside, the same in all frames, as the
skeletons differ, were tried: girths came out within 3 cm of these, markers farther off the skin.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.posing import Smpl, shaped_joints
from bridge.body.surface_operators import vertex_normals
from bridge.markers.marker_files import Markers
from bridge.markers.registration import nearest_vertices, register
from bridge.motion import Motion, unpack_theta

_ROUNDS = 4
_FRAMES = 12
_STANDOFF_M = 0.0095
"""From skin to the middle of a marker."""
_OFF_M = 0.02
"""How far a marker may be off, in the mean over frames, at the weight of one beta."""
_SIDEWAYS = 0.3
"""What a distance along the skin counts beside one across it."""
_STEP = 0.01


@dataclass(frozen=True, eq=False)
class FittedPerson:
    """Betas, and how far markers are off the skin, medians in millimetres."""

    betas: NDArray[np.float64]
    mean_shape_mm: float
    fitted_mm: float


def fit_person(body: BodyModelData, motion: Motion, markers: Markers) -> FittedPerson:
    """Fit the shape of a body model to markers.

    Parameters
    ----------
    motion : the file's, y up; its betas are not looked at.

    Raises
    ------
    DsnetError
        If the markers do not lie on the body or do not last as long.
    """
    fit = _Fit(body, motion, markers)
    off_mm = [fit.improve() for _ in range(_ROUNDS)]
    return FittedPerson(fit.betas, off_mm[0], fit.nearest()[2])


def _performed(body: BodyModelData, motion: Motion, betas: NDArray) -> Motion:
    own = replace(motion, betas=betas)
    return own.about_root_joint(shaped_joints(body, betas[None])[0, 0])


class _Fit:
    """Betas and a shift (3,) that are getting better."""

    def __init__(self, body: BodyModelData, motion: Motion, markers: Markers) -> None:
        count = len(motion.theta)
        self._some = np.linspace(0, count - 1, min(count, _FRAMES)).astype(int)
        self._body, self._motion = body, motion
        self._shapes = body.shapedirs.shape[-1]
        self._found = np.zeros(self._shapes + 3)
        mean = _performed(body, motion, self.betas)
        self._cloud = register(body, mean, markers, shortest_s=0.0).cloud

    @property
    def betas(self) -> NDArray[np.float64]:
        return self._found[: self._shapes]

    def _places_m(self, smpl: Smpl, found: NDArray) -> NDArray[np.float64]:
        """(T, N, 3)."""
        betas, shift = np.split(found, [self._shapes])
        motion = replace(self._motion, theta=self._motion.theta[self._some])
        pose, trans = unpack_theta(_performed(self._body, motion, betas).theta)
        return np.asarray(smpl.person(betas).pose(pose, trans + shift), np.float64)

    def nearest(self) -> tuple[NDArray, dict[str, int], float]:
        """Posed skin (T, V, 3), of each marker the vertex that stays nearest, and how far off,
        median, millimetres."""
        skin = self._places_m(Smpl(self._body, dtype=np.float64), self._found)
        points = {label: points_m[self._some] for label, points_m in self._cloud.points_m.items()}
        vertices, off_mm = nearest_vertices(self._body, skin, points, {})
        return skin, vertices, float(np.median(list(off_mm.values())))

    def improve(self) -> float:
        """One step of Gauss and Newton; gives how far markers were off before it."""
        body, cloud, some = self._body, self._cloud, self._some
        skin, vertices, off_mm = self.nearest()
        rows = np.array(list(vertices.values()))
        seen = np.stack([cloud.seen[label][some] for label in vertices], axis=1)
        out = np.stack([vertex_normals(frame, body.faces)[rows] for frame in skin])
        smpl, here = Smpl(body, rows, np.float64), skin[:, rows]
        apart = np.stack([cloud.points_m[label][some] for label in vertices], axis=1) - here
        apart = apart - _STANDOFF_M * out
        steps = self._found + _STEP * np.eye(len(self._found))
        moves = np.stack([(self._places_m(smpl, step) - here) / _STEP for step in steps])
        # Where along the skin a marker is stuck nobody says; hair and shoes are no skin.
        sizes_m = np.linalg.norm(apart, axis=-1).mean(0)
        trust = seen / len(some) / _OFF_M**2 / np.maximum(sizes_m / (1.5 * np.median(sizes_m)), 1)
        across, moves_across = (apart * out).sum(-1), (moves * out).sum(-1)
        weights = np.concatenate([trust.ravel(), np.repeat(_SIDEWAYS**2 * trust.ravel(), 3)])
        wanted = np.concatenate([across.ravel(), apart.ravel()])
        count = len(moves)
        system = np.hstack([moves_across.reshape(count, -1), moves.reshape(count, -1)]).T
        prior = (np.arange(count) < self._shapes).astype(float)
        right = system.T @ (weights * wanted) - prior * self._found
        hessian = system.T @ (weights[:, None] * system) + np.diag(prior)
        self._found = self._found + np.linalg.solve(hessian, right)
        return off_mm
