"""What a tape and a scale say of a body: height, weight and girths, in the rest pose.

A girth is the convex hull of a plane section, as a tape bridges hollows. The planes lie at fixed
parts of the way between joints, so they follow the body as its shape changes and any SMPL body has
them; arms are left out.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from bridge.body.model_data import SMPL_JOINT_NAMES, BodyModelData
from bridge.body.posing import shaped_vertices
from bridge.body.surface_operators import volume_m3

DENSITY_KG_M3 = 985.0
"""Of a person: a little less than water's."""
GIRTHS = {
    "chest": ("spine2", "left_shoulder", 0.5),
    "waist": ("spine1", "spine2", 0.4),
    "hips": ("left_hip", "left_knee", 0.12),
}
"""Height of each girth's plane: from one joint to another, and what part of the way."""
_TRUNK = (
    "pelvis", "spine1", "spine2", "spine3", "left_collar", "right_collar", "left_hip", "right_hip",
)  # fmt: skip


@dataclass(frozen=True)
class Measurements:
    """Of one person."""

    height: float
    """From soles to crown, cm."""
    weight: float
    """Of the volume at `DENSITY_KG_M3`, kg."""
    chest: float
    """Girth, cm: see `GIRTHS`."""
    waist: float
    """Girth, cm."""
    hips: float
    """Girth, cm."""

    def __str__(self) -> str:
        return " ".join(f"{name}={value:.1f}" for name, value in asdict(self).items())


MEASURES = tuple(Measurements.__dataclass_fields__)


class MeasuredBody:
    """A body model whose shapes are measured.

    Parameters
    ----------
    body : the model.
    """

    def __init__(self, body: BodyModelData) -> None:
        self._body = body
        trunk = body.weights[:, [SMPL_JOINT_NAMES.index(name) for name in _TRUNK]].sum(axis=1) > 0.5
        self._trunk = body.faces[trunk[body.faces].all(axis=1)]

    def __call__(self, betas: NDArray) -> Measurements:
        """Of the shape betas (10,).

        Raises
        ------
        DsnetError
            If there are other than ten.
        """
        vertices = shaped_vertices(self._body, np.asarray(betas)[None])[0]
        joints = self._body.J_regressor @ vertices
        heights_m: dict[str, float] = dict(zip(SMPL_JOINT_NAMES, joints[:, 1], strict=True))
        girths = {
            name: 100 * self._girth_m(vertices, (1 - part) * heights_m[one] + part * heights_m[two])
            for name, (one, two, part) in GIRTHS.items()
        }
        weight_kg = DENSITY_KG_M3 * volume_m3(vertices, self._body.faces)
        return Measurements(100 * float(np.ptp(vertices[:, 1])), weight_kg, **girths)

    def _girth_m(self, vertices: NDArray, height_m: float) -> float:
        # Importing it takes longer than the first frames of a motion, which need no tape.
        import trimesh

        # Only faces that the plane meets: handing over the whole trunk costs ten times as much.
        above = (vertices[:, 1] > height_m)[self._trunk].sum(axis=1)
        cut = trimesh.Trimesh(vertices, self._trunk[(above > 0) & (above < 3)], process=False)
        lines = trimesh.intersections.mesh_plane(cut, [0, 1, 0], [0, height_m, 0])
        # Of a flat hull SciPy calls the length of its border its area.
        return float(ConvexHull(np.reshape(lines, (-1, 3))[:, [0, 2]]).area)
