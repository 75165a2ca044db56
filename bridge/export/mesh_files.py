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
import trimesh
from numpy.typing import NDArray
from scipy import sparse
from trimesh.exchange.obj import export_obj
from trimesh.exchange.ply import export_ply

from bridge.export.output import about, about_in_a_line
from bridge.runtime.moving_body import MovingBody

_OBJ_DIGITS = 6
"""After the point: micrometres."""


class VertexNormals:
    """Unit normals of a surface's vertices: the mean of the faces about each, by their areas.

    `faces` (F, 3) have their vertices counter-clockwise from outside.
    """

    def __init__(self, faces: NDArray, vertex_count: int) -> None:
        self._faces = faces
        found = trimesh.geometry.index_sparse(vertex_count, faces, dtype=np.float32)
        self._faces_of_vertex = sparse.csr_array(found)  # (V, F)

    def __call__(self, vertices: NDArray) -> NDArray[np.float32]:
        """(V, 3) of vertices (V, 3); zero where a vertex has no area about it."""
        corners = vertices[self._faces]
        area_vectors = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals = self._faces_of_vertex @ area_vectors
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        return (normals / np.where(length > 0, length, 1)).astype(np.float32)


def surfaces(
    moving: MovingBody, what: str | None = None
) -> Iterator[tuple[NDArray, NDArray, NDArray]]:
    """Of each frame, told as `what`, if as any, on the terminal: places and normals (V, 3), metres,
    and sizes of the skin offsets (V,)."""
    normals = VertexNormals(moving.body.faces, moving.body.vertex_count)
    for posed in moving.shown(what) if what else moving:
        sizes_m = np.linalg.norm(posed.offsets_m, axis=-1)
        for vertices_m, size_m in zip(posed.vertices_m, sizes_m, strict=True):
            yield vertices_m, normals(vertices_m), size_m


def write_obj(folder: Path, moving: MovingBody) -> None:
    """Write `frame_00000.obj`, ... into an empty folder."""
    comment = about_in_a_line(moving)
    for number, mesh in enumerate(_meshes(moving, "obj")):
        _save_obj(folder / f"frame_{number:05d}.obj", mesh, f"frame {number} of {comment}")


def write_ply(folder: Path, moving: MovingBody) -> None:
    """Write `frame_00000.ply`, ..., binary, with the size of each vertex's skin offset."""
    comment = about_in_a_line(moving)
    for number, mesh in enumerate(_meshes(moving, "ply")):
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
    first = next(_meshes(moving))
    _save_obj(folder / "body.obj", first, f"base mesh of a point cache: {about_in_a_line(moving)}")
    (folder / "about.json").write_text(json.dumps(about(moving), indent=2) + "\n", encoding="utf-8")


def _save_obj(path: Path, mesh: trimesh.Trimesh, comment: str) -> None:
    text = export_obj(mesh, include_normals=True, digits=_OBJ_DIGITS, header=comment)
    path.write_text(text, encoding="utf-8")


def _meshes(moving: MovingBody, what: str | None = None) -> Iterator[trimesh.Trimesh]:
    """Of each frame; `offset_m` of a vertex is the length of its skin offset."""
    for vertices_m, normals, sizes_m in surfaces(moving, what):
        yield trimesh.Trimesh(
            vertices_m,
            moving.body.faces,
            vertex_normals=normals,
            vertex_attributes={"offset_m": sizes_m},
            process=False,
        )
