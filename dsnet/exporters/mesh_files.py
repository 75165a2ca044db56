"""Meshes for tools that know no bodies: OBJ or PLY, one file a frame, and point caches.

A point cache holds positions alone; a tool applies them to a mesh with the same vertices in the
same order. That is the body in its first frame, `body.obj`; beside it `about.json` has the facts
that a cache has no room for. PC2 is 3ds Max's, which Blender's Mesh Cache and others read, MDD is
LightWave's, which Blender, Maya, Houdini and others do.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.surface_operators import vertex_normals
from dsnet.exporters.output import about, about_in_a_line
from dsnet.prediction.moving_body import MovingBody


def surfaces(
    moving: MovingBody, what: str | None = None
) -> Iterator[tuple[NDArray, NDArray, NDArray]]:
    """Of each frame, told as `what`, if as any, on the terminal: places and normals (V, 3), metres,
    and sizes of the skin offsets (V,)."""
    for posed in moving.shown(what) if what else moving:
        sizes_m = np.linalg.norm(posed.offsets_m, axis=-1)
        for vertices_m, size_m in zip(posed.vertices_m, sizes_m, strict=True):
            yield vertices_m, vertex_normals(vertices_m, moving.body.faces), size_m


def write_obj(folder: Path, moving: MovingBody) -> None:
    """Write `frame_00000.obj`, ... into an empty folder."""
    comment, faces = about_in_a_line(moving), _obj_faces(moving.body)
    for number, (vertices_m, normals, _) in enumerate(surfaces(moving, "obj")):
        path, said = folder / f"frame_{number:05d}.obj", f"frame {number} of {comment}"
        _save_obj(path, vertices_m, normals, faces, said)


def write_ply(folder: Path, moving: MovingBody) -> None:
    """Write `frame_00000.ply`, ..., binary, with the size of each vertex's skin offset."""
    import trimesh  # a second to load, which the other formats need not
    from trimesh.exchange.ply import export_ply

    comment = about_in_a_line(moving)
    for number, (vertices_m, normals, sizes_m) in enumerate(surfaces(moving, "ply")):
        mesh = trimesh.Trimesh(
            vertices_m,
            moving.body.faces,
            vertex_normals=normals,
            vertex_attributes={"offset_m": sizes_m},
            process=False,
        )
        # A comment stands after the two lines that a header begins with.
        magic, kind, rest = export_ply(mesh, vertex_normal=True).split(b"\n", 2)
        said = f"comment frame {number} of {comment}".encode("ascii")
        (folder / f"frame_{number:05d}.ply").write_bytes(b"\n".join([magic, kind, said, rest]))


def write_pc2(folder: Path, moving: MovingBody) -> None:
    """Write `body.pc2`, its base mesh and `about.json` into an empty folder.

    Little-endian: the signature, version 1, the number of points, the first frame and the frames
    between samples as float32, the number of samples; then x, y, z of every point, frame by frame.
    The rate is the scene's: a sample a frame, at 60 frames a second.
    """
    points = moving.body.vertex_count
    header = struct.pack("<12siiffi", b"POINTCACHE2\0", 1, points, 0.0, 1.0, len(moving))
    _write_cache(folder, "body.pc2", header, moving, "<f4")


def write_mdd(folder: Path, moving: MovingBody) -> None:
    """Write `body.mdd`, its base mesh and `about.json` into an empty folder.

    Big-endian: the numbers of frames and points, the time of every frame in seconds as float32;
    then x, y, z of every point, frame by frame.
    """
    times_s = np.arange(len(moving)) / moving.motion.fps
    header = struct.pack(">ii", len(moving), moving.body.vertex_count)
    _write_cache(folder, "body.mdd", header + times_s.astype(">f4").tobytes(), moving, ">f4")


def _write_cache(folder: Path, name: str, header: bytes, moving: MovingBody, dtype: str) -> None:
    with (folder / name).open("wb") as file:
        file.write(header)
        for posed in moving.shown("points"):
            file.write(np.ascontiguousarray(posed.vertices_m, dtype).tobytes())
    vertices_m, normals, _ = next(surfaces(moving))
    said = f"base mesh of a point cache: {about_in_a_line(moving)}"
    _save_obj(folder / "body.obj", vertices_m, normals, _obj_faces(moving.body), said)
    (folder / "about.json").write_text(json.dumps(about(moving), indent=2) + "\n", encoding="utf-8")


def _save_obj(path: Path, vertices_m: NDArray, normals: NDArray, faces: str, comment: str) -> None:
    """To the micrometre."""
    places = _lines("v %.6f %.6f %.6f", vertices_m) + _lines("vn %.6f %.6f %.6f", normals)
    path.write_text(f"# {comment}\n{places}{faces}", encoding="utf-8")


def _obj_faces(body: BodyModelData) -> str:
    """Places on the texture, and faces, whose corners are vertex/place/normal."""
    own = body.faces + 1
    if body.texture is None:
        return _lines("f %d//%d %d//%d %d//%d", np.stack([own, own], axis=2))
    corners = np.stack([own, body.texture.corners + 1, own], axis=2)
    faces = _lines("f %d/%d/%d %d/%d/%d %d/%d/%d", corners)
    return _lines("vt %.6f %.6f", body.texture.places) + faces


def _lines(form: str, rows: NDArray) -> str:
    return (form + "\n") * len(rows) % tuple(rows.ravel().tolist())
