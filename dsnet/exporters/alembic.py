"""Alembic: one mesh `/Body` with exact points, normals and `offset_m` of each frame.

`alembic3d` are Alembic's own Python bindings; `imath` comes with them.
"""

from __future__ import annotations

import json
from pathlib import Path

import imath
import numpy as np
from alembic3d import Abc, AbcCoreAbstract, AbcGeom
from numpy.typing import NDArray

from dsnet.exporters.mesh_files import surfaces
from dsnet.exporters.output import export_facts
from dsnet.prediction.moving_body import MovingBody

_OF_VERTICES = AbcGeom.GeometryScope.kVertexScope


def write(path: Path, moving: MovingBody) -> None:
    """Write one file: metres, y up, times in seconds from 0."""
    try:
        _write(path, moving)
    except RuntimeError as error:  # Alembic raises no other
        raise OSError(str(error).splitlines()[-1].strip()[:200]) from error


def _write(path: Path, moving: MovingBody) -> None:
    faces, fps = moving.body.faces, moving.motion.fps
    # Alembic ends the process if its description contains one of these characters.
    facts = json.dumps(export_facts(moving)).replace("=", "\\u003d").replace(";", "\\u003b")
    archive = Abc.CreateArchiveWithInfo(str(path), fps, "dsnet", facts)
    archive.addTimeSampling(AbcCoreAbstract.TimeSampling(1 / fps, 0.0))
    body = AbcGeom.OPolyMesh(archive.getTop(), "Body")
    mesh = body.getSchema()
    mesh.setTimeSampling(1)
    parameters = mesh.getArbGeomParams()
    sizes = AbcGeom.OFloatGeomParam(parameters, "offset_m", False, _OF_VERTICES, 1, 1)
    # Alembic's faces list their vertices clockwise as seen from outside.
    corners = imath.IntArrayFromBuffer(faces[:, ::-1].astype(np.int32).ravel())
    counts = imath.IntArrayFromBuffer(np.full(len(faces), faces.shape[1], np.int32))
    for vertices_m, normals, sizes_m in surfaces(moving, "abc"):
        sample = AbcGeom.OPolyMeshSchemaSample(_vectors(vertices_m), corners, counts)
        sample.setNormals(AbcGeom.ON3fGeomParamSample(_vectors(normals), _OF_VERTICES))
        mesh.set(sample)
        size = imath.FloatArrayFromBuffer(sizes_m.astype(np.float32))
        sizes.set(AbcGeom.OFloatGeomParamSample(size, _OF_VERTICES))


def _vectors(array: NDArray) -> imath.V3fArray:
    return imath.V3fArrayFromBuffer(np.ascontiguousarray(array, np.float32))
