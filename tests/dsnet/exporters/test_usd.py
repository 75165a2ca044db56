"""USD as its own library reads it: metadata, points, normals."""

# USD's modules are compiled and come without types.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh

from bridge.body.skin import ROUGHNESS, skin_png
from dsnet.exporters.stage_export import ExportConfig, main
from tests.dsnet.exporters.conftest import FRAMES, moving_body

pytest.importorskip("pxr")
from pxr import Usd, UsdGeom, UsdShade, UsdValidation

from dsnet.exporters import usd


@pytest.fixture(scope="module")
def path(performed, tmp_path_factory):
    path = tmp_path_factory.mktemp("usd") / "body.usd"
    usd.write(path, performed.moving)
    return path


@pytest.fixture
def stage(path):
    return Usd.Stage.Open(str(path))


def samples(attribute, times=range(FRAMES)):
    return np.array([np.array(attribute.Get(time)) for time in times])


def test_rate_units_axis_and_origin(stage):
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == 60.0
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, FRAMES - 1)
    assert stage.GetDefaultPrim().GetPath() == "/Body"
    layer = stage.GetRootLayer()
    assert layer.comment.startswith("synthetic")
    assert json.loads(layer.customLayerData["dsnet"])["data"] == "synthetic"


def complaints(stage) -> list[str]:
    """What usdchecker says."""
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    assert validators
    return [error.GetMessage() for error in errors]


def test_it_is_valid(stage):
    assert complaints(stage) == []


def test_texture(performed, stage):
    primvar = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/Body/Mesh")).GetPrimvar("st")
    assert primvar.GetInterpolation() == "faceVarying"
    places, corners = performed.moving.body.texture
    flat = np.array(primvar.ComputeFlattened())
    np.testing.assert_allclose(flat, places[corners.ravel()], atol=1e-6)


def test_points_normals_extent_and_offsets(performed, stage):
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Body/Mesh"))
    assert mesh.GetPrim().GetStage().GetDefaultPrim().GetTypeName() == "Xform"
    np.testing.assert_array_equal(samples(mesh.GetPointsAttr()), performed.vertices_m)
    faces = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
    np.testing.assert_array_equal(faces, performed.moving.body.faces)
    assert set(mesh.GetFaceVertexCountsAttr().Get()) == {3}
    assert mesh.GetNormalsInterpolation() == "vertex"
    last = FRAMES - 1
    peer = trimesh.Trimesh(performed.vertices_m[last], faces, process=False).vertex_normals
    normals = np.array(mesh.GetNormalsAttr().Get(last))
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-5)
    assert np.median(np.einsum("vx,vx->v", normals, peer)) > 0.99
    extents = samples(mesh.GetExtentAttr())
    bounds = np.stack([performed.vertices_m.min(1), performed.vertices_m.max(1)], axis=1)
    np.testing.assert_array_equal(extents, bounds)
    size = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("offset_m")
    assert size.GetInterpolation() == "vertex"
    expected_m = np.linalg.norm(performed.offsets_m, axis=-1)
    np.testing.assert_allclose(samples(size), expected_m, rtol=1e-6)


@pytest.fixture(scope="module")
def package(character, tmp_path_factory):
    path = tmp_path_factory.mktemp("usdz") / "body.usdz"
    usd.write(path, moving_body(character, 3))
    assert [one.name for one in path.parent.iterdir()] == ["body.usdz"]
    return path


def test_a_package_has_the_picture_of_skin_uncompressed_and_aligned(character, package):
    data = package.read_bytes()
    with zipfile.ZipFile(package) as files:
        assert files.namelist() == ["body.usdc", "skin.png"]
        assert files.read("skin.png") == skin_png(character.body)
        for info in files.infolist():
            assert info.compress_type == zipfile.ZIP_STORED
            assert data.index(files.read(info)) % 64 == 0


def test_a_packages_material_shows_the_picture_where_st_says(package):
    stage = Usd.Stage.Open(str(package))
    assert complaints(stage) == []
    mesh = stage.GetPrimAtPath("/Body/Mesh")
    material, _ = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()
    surface, output, _ = material.ComputeSurfaceSource()
    assert surface.GetIdAttr().Get() == "UsdPreviewSurface"
    assert surface.GetInput("roughness").Get() == pytest.approx(ROUGHNESS)
    picture, output, _ = surface.GetInput("diffuseColor").GetConnectedSource()
    assert (UsdShade.Shader(picture).GetIdAttr().Get(), output) == ("UsdUVTexture", "rgb")
    assert picture.GetInput("file").Get().resolvedPath == f"{package}[skin.png]"
    places, _, _ = picture.GetInput("st").GetConnectedSource()
    assert UsdGeom.PrimvarsAPI(mesh).HasPrimvar(places.GetInput("varname").Get())


def test_a_skin_changes_nothing_else(performed, package, tmp_path):
    moving = moving_body(performed.moving.trained, 3)
    usd.write(tmp_path / "body.usdc", moving)
    usd.write(tmp_path / "again.usdz", moving)
    assert (tmp_path / "again.usdz").read_bytes() == package.read_bytes()
    moving.plain = True
    usd.write(tmp_path / "plain.usdz", moving)
    with zipfile.ZipFile(tmp_path / "plain.usdz") as files:
        assert files.namelist() == ["body.usdc"]
        assert files.read("body.usdc") == (tmp_path / "body.usdc").read_bytes()
    stages = [Usd.Stage.Open(str(path)) for path in (package, tmp_path / "body.usdc")]
    skinned, plain = (stage.GetPrimAtPath("/Body/Mesh") for stage in stages)
    for plain_one in plain.GetAttributes():
        own = skinned.GetAttribute(plain_one.GetName())
        assert own.GetTimeSamples() == plain_one.GetTimeSamples()
        assert own.Get(2) == plain_one.Get(2)


def test_frames_go_to_the_disk_while_others_are_predicted(character, tmp_path, monkeypatch):
    monkeypatch.setattr("dsnet.prediction.models.FRAMES_AT_ONCE", 4)
    moving, path, on_disk = moving_body(character, 12), tmp_path / "body.usd", []
    pieces = list(moving)

    def watched(_):
        for piece in pieces:
            on_disk.append(path.stat().st_size if path.exists() else 0)
            yield piece

    monkeypatch.setattr(type(moving), "__iter__", watched)
    usd.write(path, moving)
    _, *while_writing = on_disk
    assert np.diff([0, *while_writing]).min() > 100_000


def test_a_text_file_by_its_suffix(performed, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "dsnet.exporters.stage_export._moving_bodies",
        lambda config, source: [moving_body(performed.moving.trained, 2)],
    )
    out = tmp_path / "body.usda"
    main(ExportConfig(to="usd", out=out))
    assert out.read_text().startswith("#usda")
    assert [path.name for path in tmp_path.iterdir()] == ["body.usda"]


@pytest.mark.parametrize("name", ["body.usd", "body.usdz"])
def test_a_place_that_usd_cannot_write_is_told(performed, name):
    with pytest.raises(OSError, match="/proc/"):
        usd.write(Path("/proc") / name, performed.moving)
