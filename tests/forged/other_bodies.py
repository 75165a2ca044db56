"""Bodies that are the embedded one in other clothes: other shapes, place, holes, loose pieces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bridge.body import BodyModelData
from tests.forged.bodies import PELVIS_M


def with_other_shapes(
    body: BodyModelData, seed: int = 0
) -> tuple[BodyModelData, NDArray[np.float64], NDArray[np.float64]]:
    """The same people told by other numbers: betas of the body are `betas @ mix + mean` of the
    old one."""
    rng = np.random.default_rng(seed)
    mix, _ = np.linalg.qr(rng.normal(size=(body.shapedirs.shape[2],) * 2))
    mean = rng.uniform(-0.8, 0.8, len(mix))
    other = replace(
        body,
        name="other shapes",
        v_template=body.v_template + body.shapedirs @ mean,
        shapedirs=body.shapedirs @ mix.T,
    )
    return other, mix, mean


def with_pelvis_off(body: BodyModelData) -> BodyModelData:
    """The same body, its pelvis where real files have it."""
    return replace(body, name="pelvis off", v_template=body.v_template + PELVIS_M)


def open_in_pieces(body: BodyModelData) -> BodyModelData:
    """The same body with a hole under each foot, and two loose balls in its head."""
    low = body.v_template[:, 1] < body.v_template[:, 1].min() + 0.004
    faces = body.faces[~low[body.faces].any(axis=1)]
    ball, ball_faces = _ball()
    head = body.joints[15] + [0.0, 0.05, 0.03]
    count, near = body.vertex_count, int(np.linalg.norm(body.v_template - head, axis=1).argmin())
    places = [head + [side * 0.03, 0.0, 0.0] + 0.012 * ball for side in (1, -1)]
    added = 2 * len(ball)
    weights = np.zeros((added, body.weights.shape[1]))
    weights[:, 15] = 1.0

    def more(values: NDArray) -> NDArray:
        return np.concatenate([values, np.repeat(values[near][None], added, 0)])

    return replace(
        body,
        name="open, in pieces",
        v_template=np.concatenate([body.v_template, *places]),
        shapedirs=more(body.shapedirs),
        posedirs=more(body.posedirs),
        weights=np.concatenate([body.weights, weights]),
        J_regressor=sp.hstack(
            [body.J_regressor, sp.csr_matrix((len(body.parents), added))], format="csr"
        ),
        faces=np.concatenate([faces, count + ball_faces, count + len(ball) + ball_faces]),
    )


def _ball() -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """An octahedron of unit radius."""
    corners = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
    faces = [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]
    return corners, np.array(faces)
