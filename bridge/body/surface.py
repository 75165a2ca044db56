"""Checks of a body's faces: what is not a closed surface wound outwards is refused."""

from __future__ import annotations

import numpy as np
import trimesh

from bridge.body.model_data import BodyModelData
from bridge.errors import DsnetError


def checked_surface(data: BodyModelData) -> BodyModelData:
    """The model itself, if its faces are one closed surface wound counter-clockwise from outside.

    Raises
    ------
    DsnetError
        If faces repeat a vertex, leave holes, wind inconsistently, are several pieces or lie
        inside out.
    """
    if repeated := int((np.diff(np.sort(data.faces, axis=1), axis=1) == 0).any(axis=1).sum()):
        raise _refused(data, f"{repeated} faces that repeat a vertex")
    mesh = trimesh.Trimesh(data.v_template, data.faces, process=False)
    if not mesh.is_watertight:
        raise _refused(data, "faces that leave holes")
    if not mesh.is_winding_consistent:
        raise _refused(data, "neighbouring faces that wind in opposite directions")
    if mesh.body_count != 1:
        raise _refused(data, f"faces in {mesh.body_count} pieces")
    if mesh.volume <= 0:
        raise _refused(data, "faces that wind clockwise seen from outside")
    return data


def _refused(data: BodyModelData, received: str) -> DsnetError:
    return DsnetError(
        f"body model {data.name}: {received}",
        "one closed surface, wound counter-clockwise seen from outside",
        "Use an intact SMPL model file",
    )
