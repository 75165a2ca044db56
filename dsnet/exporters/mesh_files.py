"""Meshes for any tool: OBJ or PLY, one file a frame, and the point caches PC2 and MDD.

A point cache holds positions alone; a tool applies them to a mesh with the same vertices in the
same order: `body.obj`, the body in its first frame. `about.json` beside it has the facts that a
cache cannot hold. An embedded body's picture of skin lies beside an OBJ, with the material
`body.mtl`. PC2 comes from 3ds Max and is read by Blender's Mesh Cache and others; MDD comes
from LightWave and is read by Blender, Maya, Houdini and others.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body.surface_operators import vertex_normals
from dsnet.exporters.output import export_facts, facts_in_a_line
from dsnet.prediction.moving_body import MovingBody

_MATERIAL, _PICTURE = "body.mtl", "skin.png"
_SKIN = f"newmtl skin\nKa 0 0 0\nKd 1 1 1\nKs 0.04 0.04 0.04\nNs 10\nillum 2\nmap_Kd {_PICTURE}\n"


def surfaces(
    moving: MovingBody, what: str | None = None
) -> Iterator[tuple[NDArray, NDArray, NDArray]]:
    """Vertices (V, 3), normals (V, 3) and sizes of the skin offsets (V,) of each frame, metres.

    Progress is shown on the terminal with the label `what`, if there is one.
    """
    for posed in moving.shown(what) if what else moving:
        sizes_m = np.linalg.norm(posed.offsets_m, axis=-1)
        for vertices_m, size_m in zip(posed.vertices_m, sizes_m, strict=True):
            yield vertices_m, vertex_normals(vertices_m, moving.body.faces), size_m


def write_obj(folder: Path, moving: MovingBody) -> None:
    """Write `frame_00000.obj`, ... into an empty folder."""
    comment, faces = facts_in_a_line(moving), _obj_faces(moving, folder)
    for number, (vertices_m, normals, _) in enumerate(surfaces(moving, "obj")):
        path, header = folder / f"frame_{number:05d}.obj", f"frame {number} of {comment}"
        _save_obj(path, vertices_m, normals, faces, header)


def write_ply(folder: Path, moving: MovingBody) -> None:
    """Write `frame_00000.ply`, ..., binary, with the size of each vertex's skin offset."""
    import trimesh  # takes a second, and the other formats do not need it
    from trimesh.exchange.ply import export_ply

    comment = facts_in_a_line(moving)
    for number, (vertices_m, normals, sizes_m) in enumerate(surfaces(moving, "ply")):
        mesh = trimesh.Trimesh(
            vertices_m,
            moving.body.faces,
            vertex_normals=normals,
            vertex_attributes={"offset_m": sizes_m},
            process=False,
        )
        # Comments follow the first two lines of the header.
        magic, kind, rest = export_ply(mesh, vertex_normal=True).split(b"\n", 2)
        inserted = f"comment frame {number} of {comment}".encode("ascii")
        (folder / f"frame_{number:05d}.ply").write_bytes(b"\n".join([magic, kind, inserted, rest]))


def write_pc2(folder: Path, moving: MovingBody) -> None:
    """Write `body.pc2`, its base mesh and `about.json` into an empty folder.

    The format holds no rate: set the scene to 60 frames a second, one sample a frame.
    """
    header = pc2_header(moving.body.vertex_count, len(moving))
    _write_cache(folder, "body.pc2", header, moving, "<f4")


def pc2_header(points: int, samples: int) -> bytes:
    """What stands before x, y, z of every point, frame by frame, as little-endian float32.

    The signature, version 1, the number of points, the first frame and the frames between samples
    as float32, the number of samples.
    """
    return struct.pack("<12siiffi", b"POINTCACHE2\0", 1, points, 0.0, 1.0, samples)


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
    comment = f"base mesh of a point cache: {facts_in_a_line(moving)}"
    _save_obj(folder / "body.obj", vertices_m, normals, _obj_faces(moving, folder), comment)
    (folder / "about.json").write_text(
        json.dumps(export_facts(moving), indent=2) + "\n", encoding="utf-8"
    )


def _save_obj(path: Path, vertices_m: NDArray, normals: NDArray, faces: str, comment: str) -> None:
    """Write one OBJ file, rounded to a micrometre."""
    vertices = _lines("v %.6f %.6f %.6f", vertices_m) + _lines("vn %.6f %.6f %.6f", normals)
    path.write_text(f"# {comment}\n{vertices}{faces}", encoding="utf-8")


def _obj_faces(moving: MovingBody, folder: Path) -> str:
    """Lines of texture coordinates and faces, whose corners are vertex/texture/normal.

    A body with a picture of skin has a material of it, which is written into the folder.
    """
    body, png = moving.body, moving.skin_png
    faces = body.faces + 1
    if body.texture is None:
        return _lines("f %d//%d %d//%d %d//%d", np.stack([faces, faces], axis=2))
    corners = np.stack([faces, body.texture.corners + 1, faces], axis=2)
    face_lines = _lines("f %d/%d/%d %d/%d/%d %d/%d/%d", corners)
    places = _lines("vt %.6f %.6f", body.texture.places)
    if png is None:
        return places + face_lines
    (folder / _PICTURE).write_bytes(png)
    (folder / _MATERIAL).write_text(_SKIN, encoding="utf-8")
    return f"mtllib {_MATERIAL}\n{places}usemtl skin\n{face_lines}"


def _lines(template: str, rows: NDArray) -> str:
    return (template + "\n") * len(rows) % tuple(rows.ravel().tolist())
