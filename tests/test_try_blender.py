"""Blender: its absence is said, its steps are the page's, and a body that is off is noticed."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tools import try_blender
from tools.try_blender import ALLOWED, BOUND_MM, Truth, judge, told, ways


@pytest.mark.parametrize(
    ("python", "said"),
    [
        ("3.99", "needs Python 3.99, which is not found here"),
        ("{}.{}".format(*sys.version_info), "cannot be had: ERROR: No matching distribution"),
    ],
)
def test_what_cannot_be_had_is_one_line_and_leaves_nothing(
    python, said, monkeypatch, capsys, tmp_path: Path
):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(try_blender, "PYTHON", python)
    monkeypatch.setattr(try_blender, "PACKAGES", ("--no-index", "there-is-no-blender-here==1"))
    assert try_blender.main() == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith("not tried: ")
    assert said in line
    assert not list(tmp_path.iterdir())


def test_the_page_tells_every_step_that_is_tried():
    assert {"usd", "glb", "abc", "pc2", "mdd", "bvh", "obj", "ply"} <= {way.name for way in ways()}
    with pytest.raises(SystemExit, match=r"export.md, Blender, USD: nothing there is Frame Rate"):
        told("USD", r"Frame Rate\* to (61)")


@pytest.fixture
def truth() -> Truth:
    ball = trimesh.creation.icosphere(radius=0.85)
    vertices_m = np.add(ball.vertices, [0, 0, 0.85], dtype=np.float32)
    sizes_m = np.linspace(0, 0.01, len(vertices_m), dtype=np.float32)
    return Truth(np.array([0]), vertices_m[None], vertices_m[None, :24] + 1, sizes_m[None], 9)


@pytest.fixture
def seen(truth: Truth) -> dict[str, np.ndarray]:
    ball = trimesh.creation.icosphere(radius=0.85)
    return {
        "vertices_m": truth.vertices_m.copy(),
        "faces": np.array([ball.faces]),
        "normals": np.array([ball.vertices / 0.85]),
        "offset_m": truth.sizes_m.copy(),
        "imported_fps": np.array([24]),
        "range": np.array([0, 9]),
        "bones": np.array([24]),
    }


@pytest.mark.parametrize(
    ("key", "change", "said"),
    [
        ("vertices_m", lambda v: np.add(v, [2e-5, 0, 0]), "more than 0.01"),
        ("vertices_m", lambda v: 100 * v, "height_m is 170"),
        ("normals", lambda n: -n, "normals_off_deg is 180"),
        ("offset_m", lambda s: np.nan * s, "offset_m_off is nan"),
        ("imported_fps", lambda f: f + 36, "rate_after_import is 60"),
        ("range", lambda r: np.add(r, [1, 0]), "frames_off is 1"),
        ("bones", lambda b: b[:0], "bones is 0"),
    ],
)
def test_a_body_that_is_not_is_noticed(key, change, said, seen, truth):
    assert judge(tuple(ALLOWED), BOUND_MM, seen, truth) == (0, [])
    _, wrong = judge(tuple(ALLOWED), BOUND_MM, {**seen, key: change(seen[key])}, truth)
    assert any(what.startswith(said) for what in wrong), wrong
