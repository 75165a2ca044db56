"""OpenUSD: one mesh `/Body/Mesh` with exact points, normals and extent of every frame.

`primvars:offset_m` is the size of each skin offset; `primvars:st` is there if the body has a
texture. A package `.usdz`, which is the one form that can hold pictures, has the material
`/Body/Skin` with an embedded body's picture of skin.
"""

# USD's modules are compiled and come without types.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Tf, Usd, UsdGeom, UsdShade, Vt

from bridge.body.skin import ROUGHNESS
from dsnet.exporters.mesh_files import surfaces
from dsnet.exporters.output import export_facts, facts_in_a_line
from dsnet.prediction import models
from dsnet.prediction.moving_body import MovingBody

ROOT, MESH, SKIN = "/Body", "/Body/Mesh", "/Body/Skin"
_PICTURE = "skin.png"
_PACKED_S = 946_728_000
"""Time of the files in a package, 2000-01-01 12:00 UTC: equal bodies give equal bytes."""


def write(path: Path, moving: MovingBody) -> None:
    """Write a USD file: one time code a frame, from 0, 60 a second; metres, y up.

    A file `.usdz` is a package of the stage and the picture of skin, if the body has one.
    """
    try:
        if path.suffix.lower() == ".usdz":
            _write_package(path, moving)
        else:
            _save(_new_stage(path, moving), moving)
    except Tf.ErrorException as error:
        raise OSError(str(error).splitlines()[-1].strip()[:200]) from error


def _write_package(path: Path, moving: MovingBody) -> None:
    with tempfile.TemporaryDirectory(dir=path.parent) as name:
        files = [Path(name) / "body.usdc"]  # the first is the one that is opened
        stage = _new_stage(files[0], moving)
        if png := moving.skin_png:
            files.append(Path(name) / _PICTURE)
            files[1].write_bytes(png)
            _add_skin(stage)
        _save(stage, moving)
        package = Sdf.ZipFileWriter.CreateNew(str(path))
        for file in files:
            os.utime(file, (_PACKED_S, _PACKED_S))
        if not (all(package.AddFile(str(one), one.name) for one in files) and package.Save()):
            raise OSError("USD could not write its package")


def _add_skin(stage: Usd.Stage) -> None:
    """A material of the picture beside the stage, bound to the mesh."""
    material = UsdShade.Material.Define(stage, SKIN)
    surface, picture, places = (
        UsdShade.Shader.Define(stage, f"{SKIN}/{name}") for name in ("Surface", "Picture", "Places")
    )
    types = Sdf.ValueTypeNames
    places.CreateIdAttr("UsdPrimvarReader_float2")
    places.CreateInput("varname", types.String).Set("st")
    picture.CreateIdAttr("UsdUVTexture")
    picture.CreateInput("file", types.Asset).Set(_PICTURE)
    picture.CreateInput("sourceColorSpace", types.Token).Set("sRGB")
    for wrap in ("wrapS", "wrapT"):
        picture.CreateInput(wrap, types.Token).Set("clamp")
    place = places.CreateOutput("result", types.Float2)
    picture.CreateInput("st", types.Float2).ConnectToSource(place)
    surface.CreateIdAttr("UsdPreviewSurface")
    colour = picture.CreateOutput("rgb", types.Float3)
    surface.CreateInput("diffuseColor", types.Color3f).ConnectToSource(colour)
    surface.CreateInput("roughness", types.Float).Set(ROUGHNESS)
    surface.CreateInput("metallic", types.Float).Set(0.0)
    material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", types.Token))
    UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath(MESH)).Bind(material)


def _save(stage: Usd.Stage, moving: MovingBody) -> None:
    _write_frames(stage, moving)
    stage.Save()


def _new_stage(path: Path, moving: MovingBody) -> Usd.Stage:
    stage, facts = Usd.Stage.CreateNew(str(path)), export_facts(moving)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, UsdGeom.LinearUnits.meters)
    stage.SetTimeCodesPerSecond(moving.motion.fps)
    stage.SetFramesPerSecond(moving.motion.fps)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(len(moving) - 1)
    layer = stage.GetRootLayer()
    layer.comment = facts_in_a_line(moving)
    layer.customLayerData = {"dsnet": json.dumps(facts)}
    root = UsdGeom.Xform.Define(stage, ROOT).GetPrim()
    stage.SetDefaultPrim(root)
    Usd.ModelAPI(root).SetKind("component")
    mesh, faces = UsdGeom.Mesh.Define(stage, MESH), moving.body.faces
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(faces), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(faces.astype(np.int32).ravel()))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    if texture := moving.body.texture:
        coordinates = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
            "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying
        )
        coordinates.Set(Vt.Vec2fArray.FromNumpy(texture.places.astype(np.float32)))
        coordinates.SetIndices(Vt.IntArray.FromNumpy(texture.corners.astype(np.int32).ravel()))
    return stage


def _write_frames(stage: Usd.Stage, moving: MovingBody) -> None:
    mesh = UsdGeom.Mesh.Get(stage, MESH)
    points, normals = mesh.CreatePointsAttr(), mesh.CreateNormalsAttr()
    extent = mesh.CreateExtentAttr()
    size = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        "offset_m", Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.vertex
    )
    for time, (vertices_m, vertex_normals, sizes_m) in enumerate(surfaces(moving, "usd")):
        points.Set(_vectors(vertices_m), time)
        normals.Set(_vectors(vertex_normals), time)
        extent.Set(_vectors(np.stack([vertices_m.min(axis=0), vertices_m.max(axis=0)])), time)
        size.Set(Vt.FloatArray.FromNumpy(sizes_m), time)
        if (time + 1) % models.FRAMES_AT_ONCE == 0:  # saved frames are no longer held in memory
            stage.Save()


def _vectors(array: NDArray) -> Vt.Vec3fArray:
    """An array (N, 3) as USD's vectors, in float32."""
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(array, np.float32))
