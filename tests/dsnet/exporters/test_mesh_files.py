"""PC2, MDD, OBJ and PLY, read again by readers that know the formats and not their writers."""

from __future__ import annotations

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from bridge.body.skin import skin_png
from dsnet.exporters.mesh_files import write_mdd, write_obj, write_pc2, write_ply
from dsnet.prediction.moving_body import MovingBody
from tests.dsnet.exporters.conftest import FRAMES, moving_body


def test_pc2(performed, tmp_path):
    write_pc2(tmp_path, performed.moving)
    data = (tmp_path / "body.pc2").read_bytes()
    assert data[:12] == b"POINTCACHE2\0"
    version, points, start, rate, samples = struct.unpack("<iiffi", data[12:32])
    assert (version, points, start, rate, samples) == (1, 6890, 0.0, 1.0, FRAMES)
    stored = np.frombuffer(data[32:], "<f4").reshape(samples, points, 3)
    np.testing.assert_array_equal(stored, performed.vertices_m)


def test_mdd(performed, tmp_path):
    write_mdd(tmp_path, performed.moving)
    data = (tmp_path / "body.mdd").read_bytes()
    frames, points = struct.unpack(">ii", data[:8])
    assert (frames, points) == (FRAMES, 6890)
    times_s = np.frombuffer(data, ">f4", frames, 8)
    np.testing.assert_allclose(np.diff(times_s), 1 / 60, rtol=1e-5)
    assert times_s[0] == 0
    stored = np.frombuffer(data, ">f4", offset=8 + 4 * frames).reshape(frames, points, 3)
    np.testing.assert_array_equal(stored, performed.vertices_m)


@pytest.mark.parametrize("write", [write_pc2, write_mdd])
def test_a_caches_base_mesh_has_its_points_in_their_order(performed, tmp_path, monkeypatch, write):
    moving = MovingBody(performed.moving.trained, performed.moving.motion)
    shown, told = moving.shown, []
    monkeypatch.setattr(moving, "shown", lambda what: told.append(what) or shown(what))
    write(tmp_path, moving)
    assert told == ["points"]  # a bar that the base mesh alone would leave unfinished
    base = trimesh.load_mesh(tmp_path / "body.obj", process=False, maintain_order=True)
    np.testing.assert_allclose(base.vertices, performed.vertices_m[0], atol=1e-6)
    np.testing.assert_array_equal(base.faces, performed.moving.body.faces)
    assert (tmp_path / "body.obj").read_text().startswith("# base mesh of a point cache: synthetic")
    facts = json.loads((tmp_path / "about.json").read_text())
    stated = [facts[key] for key in ("data", "fps", "length_unit", "up_axis", "frames")]
    assert stated == ["synthetic", 60.0, "m", "y", FRAMES]


def test_obj(character, tmp_path):
    moving = moving_body(character, 3)
    write_obj(tmp_path, moving)
    (posed,) = moving
    *paths, picture = sorted(tmp_path.iterdir())[1:]
    assert [path.name for path in paths] == [f"frame_{n:05d}.obj" for n in range(3)]
    assert picture.read_bytes() == skin_png(character.body)
    assert f"map_Kd {picture.name}\n" in (tmp_path / "body.mtl").read_text()
    for path, vertices_m in zip(paths, posed.vertices_m, strict=True):
        assert "synthetic" in path.read_text().partition("\n")[0]
        mesh = trimesh.load_mesh(path, process=False, maintain_order=True)
        np.testing.assert_allclose(mesh.vertices, vertices_m, atol=1e-6)
        np.testing.assert_array_equal(mesh.faces, character.body.faces)
        lines = [line.split()[1:] for line in path.read_text().splitlines() if line[:3] == "vn "]
        np.testing.assert_allclose(np.array(lines, float), _normals(mesh), atol=1e-3)


@pytest.mark.parametrize("textured", [True, False])
def test_an_objs_texture_is_the_bodys(performed, tmp_path, textured):
    moving, body = performed.moving, performed.moving.body
    if not textured:
        body = replace(body, texture=None)
        moving = MovingBody(moving.trained.on(body, "another's"), moving.motion)
    write_pc2(tmp_path, moving)
    lines = [line.split() for line in (tmp_path / "body.obj").read_text().splitlines()]
    places = [line[1:] for line in lines if line[0] == "vt"]
    faces = np.array([[c.split("/") for c in line[1:]] for line in lines if line[0] == "f"])
    np.testing.assert_array_equal(faces[..., 0].astype(int) - 1, body.faces)
    np.testing.assert_array_equal(faces[..., 2], faces[..., 0])
    if body.texture is None:
        assert (places, set(faces[..., 1].ravel())) == ([], {""})
        return
    np.testing.assert_allclose(np.array(places, float), body.texture.places, atol=1e-6)
    np.testing.assert_array_equal(faces[..., 1].astype(int) - 1, body.texture.corners)


def test_ply(performed, tmp_path):
    write_ply(tmp_path, performed.moving)
    paths = sorted(tmp_path.iterdir())
    assert [path.name for path in paths] == [f"frame_{n:05d}.ply" for n in range(FRAMES)]
    for number in (0, FRAMES - 1):
        assert b"comment frame %d of synthetic" % number in paths[number].read_bytes()[:200]
        mesh = trimesh.load_mesh(paths[number], process=False)
        np.testing.assert_array_equal(mesh.vertices, performed.vertices_m[number])
        np.testing.assert_array_equal(mesh.faces, performed.moving.body.faces)
        stored = mesh.metadata["_ply_raw"]["vertex"]["data"]
        normals = np.column_stack([np.ravel(stored[axis]) for axis in ("nx", "ny", "nz")])
        np.testing.assert_allclose(normals, _normals(mesh), atol=1e-4)
        size_m = stored["offset_m"]
        expected_m = np.linalg.norm(performed.offsets_m[number], axis=1)
        np.testing.assert_allclose(np.ravel(size_m), expected_m, rtol=1e-5)


def _normals(mesh: trimesh.Trimesh) -> np.ndarray:
    """The mean of the faces' normals by their areas, another way."""
    found = np.zeros((len(mesh.vertices), 3))
    for corner in mesh.faces.T:
        np.add.at(found, corner, mesh.face_normals * mesh.area_faces[:, None])
    return found / np.linalg.norm(found, axis=1, keepdims=True)
