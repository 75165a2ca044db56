"""OpenUSD: one mesh `/Body/Mesh` whose points move.

It has the points, their normals, the extent and `primvars:offset_m`, the size of each skin offset,
of every frame, exactly.
"""

# USD's modules are compiled and come without types.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Tf, Usd, UsdGeom, Vt

from bridge.errors import DsnetError
from bridge.export.mesh_files import VertexNormals
from bridge.export.output import about, about_in_a_line
from bridge.runtime.moving_body import MovingBody

ROOT, MESH = "/Body", "/Body/Mesh"


def write(path: Path, moving: MovingBody) -> None:
    """Write a USD file: one time code a frame from 0, 60 a second, metres, y up."""
    try:
        stage = _new_stage(path, moving)
        _write_frames(stage, moving)
        stage.Save()
    except Tf.ErrorException as error:
        raise DsnetError(
            f"--out, which USD cannot write ({str(error).splitlines()[-1].strip()})",
            "a path that can be made, on a disk with room",
            "Name another path.",
        ) from error


def _new_stage(path: Path, moving: MovingBody) -> Usd.Stage:
    stage, facts = Usd.Stage.CreateNew(str(path)), about(moving)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, UsdGeom.LinearUnits.meters)
    stage.SetTimeCodesPerSecond(moving.motion.fps)
    stage.SetFramesPerSecond(moving.motion.fps)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(len(moving) - 1)
    layer = stage.GetRootLayer()
    layer.comment = about_in_a_line(moving)
    layer.customLayerData = {"dsnet": _custom_data(facts)}
    root = UsdGeom.Xform.Define(stage, ROOT).GetPrim()
    stage.SetDefaultPrim(root)
    Usd.ModelAPI(root).SetKind("component")
    mesh, faces = UsdGeom.Mesh.Define(stage, MESH), moving.body.faces
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(faces), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(faces.astype(np.int32).ravel()))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    return stage


def _custom_data(facts: Mapping[str, Any]) -> dict[str, Any]:
    """The same with USD's arrays in place of lists, of numbers or of texts."""
    found: dict[str, Any] = {}
    for key, value in facts.items():
        if isinstance(value, Mapping):
            value = _custom_data(value)
        elif isinstance(value, list):
            texts = all(isinstance(item, str) for item in value)
            value = Vt.StringArray(value) if texts else Vt.DoubleArray(value)
        found[key] = value
    return found


def _write_frames(stage: Usd.Stage, moving: MovingBody) -> None:
    normals_of = VertexNormals(moving.body.faces, moving.body.vertex_count)
    mesh = UsdGeom.Mesh.Get(stage, MESH)
    points, normals = mesh.CreatePointsAttr(), mesh.CreateNormalsAttr()
    extent = mesh.CreateExtentAttr()
    size = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        "offset_m", Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.vertex
    )
    for posed in moving.shown("usd"):
        sizes_m = np.linalg.norm(posed.offsets_m, axis=-1)
        for row, time in enumerate(range(posed.frames.start, posed.frames.stop)):
            vertices_m = posed.vertices_m[row]
            points.Set(_vectors(vertices_m), time)
            normals.Set(_vectors(normals_of(vertices_m)), time)
            extent.Set(_vectors(np.stack([vertices_m.min(axis=0), vertices_m.max(axis=0)])), time)
            size.Set(Vt.FloatArray.FromNumpy(sizes_m[row]), time)
        # What is saved is no longer held in memory.
        stage.Save()


def _vectors(array: NDArray) -> Vt.Vec3fArray:
    """(N, 3) as USD has it, in float32."""
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(array, np.float32))
