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
from bridge.motion import Motion, unpack_theta
from dsnet.markers.marker_files import Markers
from dsnet.markers.registration import nearest_vertices, register

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
    count, shapes = len(motion.theta), body.shapedirs.shape[-1]
    some = np.linspace(0, count - 1, min(count, _FRAMES)).astype(int)
    params = np.zeros(shapes + 3)  # betas, and a shift
    cloud = register(body, _performed(body, motion, params[:-3]), markers, to_measure=False).cloud
    points = {label: points_m[some] for label, points_m in cloud.points_m.items()}
    few, whole, off_mm = motion.frames(some), Smpl(body, dtype=np.float64), []

    def places_m(smpl: Smpl, betas_and_shift: NDArray) -> NDArray[np.float64]:
        """(T, N, 3)."""
        betas, shift = np.split(betas_and_shift, [shapes])
        pose, trans = unpack_theta(_performed(body, few, betas).theta)
        return np.asarray(smpl.person(betas).pose(pose, trans + shift), np.float64)

    for turn in range(_ROUNDS + 1):
        skin = places_m(whole, params)
        vertices, away_mm = nearest_vertices(body, skin, points, {})
        off_mm.append(float(np.median(list(away_mm.values()))))
        if turn == _ROUNDS:
            break
        rows = np.array(list(vertices.values()))
        smpl, here = Smpl(body, rows, np.float64), skin[:, rows]
        steps = params + _STEP * np.eye(len(params))
        moves = np.stack([(places_m(smpl, step) - here) / _STEP for step in steps])
        out = np.stack([vertex_normals(frame, body.faces)[rows] for frame in skin])
        apart = np.stack([points[label] for label in vertices], axis=1) - here - _STANDOFF_M * out
        seen = np.stack([cloud.seen[label][some] for label in vertices], axis=1)
        prior = (np.arange(len(params)) < shapes).astype(float)
        params = params + _newton_step(moves, apart, out, seen, prior, params)
    return FittedPerson(params[:-3], off_mm[0], off_mm[-1])


def _newton_step(
    moves: NDArray, apart: NDArray, out: NDArray, seen: NDArray, prior: NDArray, params: NDArray
) -> NDArray[np.float64]:
    """One step of Gauss and Newton: (P,) from moves (P, T, N, 3) of each parameter towards markers
    that lie apart (T, N, 3), where the skin's normals are out (T, N, 3).

    Parameters (P,) are drawn to 0 where their prior (P,) is 1, not 0.
    """
    # Where along the skin a marker is stuck nobody says; hair and shoes are no skin.
    sizes_m = np.linalg.norm(apart, axis=-1).mean(0)
    trust = seen / len(seen) / _OFF_M**2 / np.maximum(sizes_m / (1.5 * np.median(sizes_m)), 1)
    across, moves_across = (apart * out).sum(-1), (moves * out).sum(-1)
    weights = np.concatenate([trust.ravel(), np.repeat(_SIDEWAYS**2 * trust.ravel(), 3)])
    wanted = np.concatenate([across.ravel(), apart.ravel()])
    count = len(moves)
    system = np.hstack([moves_across.reshape(count, -1), moves.reshape(count, -1)]).T
    right = system.T @ (weights * wanted) - prior * params
    return np.linalg.solve(system.T @ (weights[:, None] * system) + np.diag(prior), right)


def _performed(body: BodyModelData, motion: Motion, betas: NDArray) -> Motion:
    shaped = replace(motion, betas=betas)
    return shaped.about_root_joint(shaped_joints(body, betas[None])[0, 0])
