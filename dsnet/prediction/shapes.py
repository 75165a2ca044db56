"""Shapes of a body in words: what a tape and a scale measure, and betas of requested measures.

A girth is the convex hull of a plane section, as a tape bridges hollows. The planes lie at fixed
parts of the way between joints, so they follow the body as its shape changes and any SMPL body has
them; arms are left out. All measurements are of the rest pose.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from bridge.body.model_data import SHAPE_COUNT, SMPL_JOINT_NAMES, BodyModelData
from bridge.body.posing import shaped_vertices
from bridge.body.surface_operators import volume_m3
from bridge.errors import DsnetError, did_you_mean
from bridge.options import Bounds, numbers_by_name

DENSITY_KG_M3 = 985.0
"""Of a person: a little less than water's."""
GIRTHS = {
    "chest": ("spine2", "left_shoulder", 0.5),
    "waist": ("spine1", "spine2", 0.4),
    "hips": ("left_hip", "left_knee", 0.12),
}
"""Height of each girth's plane: from one joint to another, and what part of the way."""
MEASURES = {"height": "cm", "weight": "kg", **dict.fromkeys(GIRTHS, "cm")}
"""Units: from soles to crown; of the volume at `DENSITY_KG_M3`; and of girths."""
_TRUNK = (
    "pelvis", "spine1", "spine2", "spine3", "left_collar", "right_collar", "left_hip", "right_hip",
)  # fmt: skip
SHAPES: Mapping[str, Mapping[str, float]] = {
    "tall": {"height": 1.08, "weight": 1.08**2},
    "short": {"height": 0.92, "weight": 0.92**2},
    "heavy": {"height": 1.0, "weight": 1.3},
    "slim": {"height": 1.0, "weight": 0.85},
    "pear": {"height": 1.0, "weight": 1.0, "chest": 0.97, "hips": 1.05},
    "apple": {"height": 1.0, "weight": 1.0, "waist": 1.05},
}
"""Named shapes: by what the measurements of the body model's mean person are multiplied. Of several
names, each later one of this table changes what the earlier ones made; what a name does not mention
is free to follow."""
FARTHEST_BETA = 3.0
"""Betas are in standard deviations of the people whom a body model was made from."""
CLOSE_ENOUGH = 0.5
"""In cm and kg: what may be missed."""
_CM_OR_KG = Bounds(0, 1000, ends_open=True)
_LEAST = 10.0
"""No body measures less, in cm or kg."""
_LARGEST_M = 3.0
"""No body measures more, in metres."""
_PRIOR = 0.1
"""Of a beta of 1, in such misses: it chooses among shapes that measure the same, unmeasurably."""


class MeasuredBody:
    """A body model whose shapes are measured."""

    def __init__(self, body: BodyModelData) -> None:
        self._body = body
        self.shape_count = min(SHAPE_COUNT, body.shapedirs.shape[2])
        trunk = body.weights[:, [SMPL_JOINT_NAMES.index(name) for name in _TRUNK]].sum(axis=1) > 0.5
        self._trunk = body.faces[trunk[body.faces].all(axis=1)]

    def __call__(self, betas: NDArray) -> dict[str, float]:
        """`MEASURES` of the shape betas (10,)."""
        vertices = shaped_vertices(self._body, np.asarray(betas)[None])[0]
        joints = self._body.J_regressor @ vertices
        heights_m: dict[str, float] = dict(zip(SMPL_JOINT_NAMES, joints[:, 1], strict=True))
        girths = {
            name: 100 * self._girth_m(vertices, (1 - part) * heights_m[one] + part * heights_m[two])
            for name, (one, two, part) in GIRTHS.items()
        }
        weight_kg = DENSITY_KG_M3 * volume_m3(vertices, self._body.faces)
        return {"height": 100 * float(np.ptp(vertices[:, 1])), "weight": weight_kg, **girths}

    def _girth_m(self, vertices: NDArray, height_m: float) -> float:
        # Importing these takes longer than the first frames of a motion, which need no tape.
        import trimesh
        from scipy.spatial import ConvexHull

        # Only faces that the plane meets: handing over the whole trunk costs ten times as much.
        above = (vertices[:, 1] > height_m)[self._trunk].sum(axis=1)
        cut = trimesh.Trimesh(vertices, self._trunk[(above > 0) & (above < 3)], process=False)
        lines = trimesh.intersections.mesh_plane(cut, [0, 1, 0], [0, height_m, 0])
        # Of a flat hull SciPy calls the length of its border its area.
        return float(ConvexHull(np.reshape(lines, (-1, 3))[:, [0, 2]]).area)


def find_shape(body: BodyModelData, words: Sequence[str]) -> NDArray[np.float64]:
    """(10,) betas of a shape in words.

    Parameters
    ----------
    body : whose shape space it is.
    words : names of `SHAPES`, and measurements such as `height=182`, cm and kg (`MEASURES`), each
        once; a measurement counts more than what a name says of it.
    """
    named, stated = parse_shape(words)
    measured = MeasuredBody(body)
    betas = np.zeros(measured.shape_count)
    wanted: dict[str, float] = {}
    for factors in named:
        now = measured(betas)
        wanted |= {name: factor * now[name] for name, factor in factors.items()}
        betas = betas_that_measure(measured, wanted, betas)
    return betas_that_measure(measured, wanted | stated, betas) if stated else betas


def parse_shape(words: Sequence[str]) -> tuple[list[Mapping[str, float]], dict[str, float]]:
    """What words say: the rows of `SHAPES`, in its order, and measurements by name."""
    named = {word for word in words if "=" not in word}
    if unknown := sorted(named - set(SHAPES)):
        shapes = f"{', '.join(SHAPES)}, or a measurement such as height=182"
        remedy = did_you_mean(unknown[0], SHAPES, "See docs/animation.md.")
        raise DsnetError(f"shape {unknown[0]!r}", shapes, remedy)
    measured = [word for word in words if "=" in word]
    remedy = "Write height=182, in cm; weight=80, in kg."
    stated = numbers_by_name("measurement", measured, [*MEASURES], _CM_OR_KG, remedy)
    for name, value in stated.items():
        if value < _LEAST:
            in_metres = MEASURES[name] == "cm" and value <= _LARGEST_M
            raise DsnetError(
                f"measurement {name}={value:g}",
                f"{name} in {MEASURES[name]}, {_LEAST:g} or more",
                f"Did you mean {name}={100 * value:g}?" if in_metres else remedy,
            )
    return [factors for name, factors in SHAPES.items() if name in named], stated


def betas_that_measure(
    measured: MeasuredBody, wanted: Mapping[str, float], start: NDArray | None = None
) -> NDArray[np.float64]:
    """(10,) betas nearest to zero, none farther than `FARTHEST_BETA`, that measure within
    `CLOSE_ENOUGH` of what is wanted.

    Parameters
    ----------
    wanted : some of `MEASURES`, cm and kg; the others are free.
    start : (10,) betas to search from.
    """
    # Importing it takes longer than the first frames of a motion, which need no search.
    from scipy.optimize import least_squares

    def misses(betas: NDArray) -> NDArray:
        measures = measured(betas)
        return np.array([measures[name] - value for name, value in wanted.items()])

    def residuals(betas: NDArray) -> NDArray:
        return np.concatenate([misses(betas) / CLOSE_ENOUGH, _PRIOR * betas])

    first = np.zeros(measured.shape_count) if start is None else start
    limits = (-FARTHEST_BETA, FARTHEST_BETA)
    betas = least_squares(residuals, first, bounds=limits, xtol=1e-4, ftol=1e-6).x
    if np.abs(misses(betas)).max(initial=0.0) > CLOSE_ENOUGH:
        raise DsnetError(
            f"a shape of {_listed(wanted)}",
            f"one that {measured.shape_count} betas within {FARTHEST_BETA:g} give (the nearest has "
            f"{_listed(measured(betas))})",
            "Ask for less, or for fewer measurements; --betas gives any shape.",
        )
    return betas


def _listed(measures: Mapping[str, float]) -> str:
    return ", ".join(f"{name}={value:.1f} {MEASURES[name]}" for name, value in measures.items())
