"""Alembic as its own library reads it; `python -m tools.try_blender` asks Blender."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.dsnet.exporters.conftest import FRAMES


def test_points_normals_and_offsets_of_every_frame(performed, tmp_path):
    pytest.importorskip("alembic3d")
    from alembic3d import Abc, AbcGeom

    from dsnet.exporters import alembic

    path = tmp_path / "body.abc"
    alembic.write(path, performed.moving)
    archive = Abc.IArchive(str(path))
    assert json.loads(Abc.GetArchiveInfo(archive)["userDescription"])["data"] == "synthetic"
    mesh = AbcGeom.IPolyMesh(archive.getTop(), "Body").getSchema()
    times = mesh.getTimeSampling()
    assert mesh.getNumSamples() == FRAMES
    np.testing.assert_allclose(times.getSampleTime(FRAMES - 1), (FRAMES - 1) / 60)
    sizes = AbcGeom.IFloatGeomParam(mesh.getArbGeomParams(), "offset_m")
    for frame in (0, 20, FRAMES - 1):
        chosen = Abc.ISampleSelector(frame / 60)  # the nearest sample
        sample = mesh.getValue(chosen)
        points = np.array([tuple(point) for point in sample.getPositions()], np.float32)
        np.testing.assert_array_equal(points, performed.vertices_m[frame])
        faces = np.array(list(sample.getFaceIndices())).reshape(-1, 3)
        np.testing.assert_array_equal(faces[:, ::-1], performed.moving.body.faces)  # clockwise
        size = np.array(list(sizes.getExpandedValue(chosen).getVals()), np.float32)
        expected_m = np.linalg.norm(performed.offsets_m[frame], axis=-1)
        np.testing.assert_allclose(size, expected_m, rtol=1e-6)
        normals = mesh.getNormalsParam().getExpandedValue(chosen).getVals()
        lengths = np.linalg.norm([tuple(normal) for normal in normals], axis=1)
        np.testing.assert_allclose(lengths, 1, atol=1e-5)


def test_a_place_that_alembic_cannot_write_is_told(performed):
    pytest.importorskip("alembic3d")
    from dsnet.exporters import alembic

    with pytest.raises(OSError, match="/proc/body"):
        alembic.write(Path("/proc/body.abc"), performed.moving)
