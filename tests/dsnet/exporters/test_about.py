"""What every exported file says of itself: who moved the body, and what was asked of it."""

# USD's modules are compiled and come without types.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import json
import re
import struct
import subprocess
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dsnet.cli import main
from tests.forged.amass import save, smplh

BETAS = "1,0,0,0,0,0,0,0,0,0"
ASKED = {"gain": 1.5, "part_gain": ["belly=2", "arms=0.5"], "floor": "shift", "betas": BETAS}
GAINS = ("--gain", "1.5", "--part-gain", "belly=2", "arms=0.5")
NEEDS = {"usd": "pxr", "abc": "alembic3d"}
OPTIONS = (*GAINS, "--floor", "shift", "--betas", BETAS)


@pytest.fixture(scope="module")
def motion(tmp_path_factory) -> Path:
    return save(
        tmp_path_factory.mktemp("given") / "a_poses.npz", smplh(3, 60.0), source="synthetic"
    )


@pytest.fixture(scope="module")
def predicted(motion, tmp_path_factory) -> dict:
    """The manifest of `dsnet predict` of the same motion, asked the same."""
    out = tmp_path_factory.mktemp("predicted")
    main(["predict", "--motion", str(motion), "--out", str(out), "--write", "offsets", *OPTIONS])
    return json.loads((out / "manifest.json").read_text())


@pytest.fixture
def exported(motion, tmp_path):
    """The path that one format is exported to."""

    def run(to: str, name: str, *options: str) -> Path:
        out = tmp_path / name
        main(["export", "--to", to, "--motion", str(motion), "--out", str(out), *options])
        return out

    return run


def of_frame_0(path: Path) -> str:
    """A folder of OBJ or PLY."""
    return path.read_bytes()[:1000].decode("ascii", "replace").partition("\nelement")[0]


def of_gif(path: Path) -> str:
    with Image.open(path) as clip:
        return clip.info["comment"].decode("ascii")


def of_mp4(path: Path) -> str:
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    made = subprocess.run([ffmpeg, "-i", str(path)], capture_output=True, check=False)
    return made.stderr.decode()


LINES = {
    "obj": ("out", lambda path: of_frame_0(path / "frame_00000.obj")),
    "ply": ("out", lambda path: of_frame_0(path / "frame_00000.ply")),
    "pc2": ("out", lambda path: of_frame_0(path / "body.obj")),
    "mdd": ("out", lambda path: of_frame_0(path / "body.obj")),
    "gif": ("out.gif", of_gif),
    "mp4": ("out.mp4", of_mp4),
    "html": ("out.html", lambda path: unescape(path.read_text().partition("<style>")[0])),
}


@pytest.mark.parametrize("to", LINES)
def test_a_comment_names_who_moved_it_and_what_was_asked(exported, predicted, to):
    if to == "mp4":
        pytest.importorskip("imageio_ffmpeg")
    name, read = LINES[to]
    line = read(exported(to, name, *OPTIONS))
    assert "dsnet_plus of the packaged model (female, synthetic)" in line
    (controls,) = re.findall(r"controls (\{.*?\})", line)
    assert json.loads(controls) == predicted["controls"] == ASKED


@pytest.mark.parametrize("to", ["pc2", "npz", "usd", "glb", "abc"])
def test_fields_are_those_of_the_prediction(exported, predicted, to):
    if to in NEEDS:
        pytest.importorskip(NEEDS[to])
    out = exported(to, "out" if to == "pc2" else f"out.{to}", *OPTIONS)
    readers = {"pc2": of_json, "npz": of_npz, "usd": of_usd, "glb": of_glb, "abc": of_abc}
    facts = readers[to](out)
    assert facts["controls"] == predicted["controls"] == ASKED
    assert facts["model"] == "the packaged model (female, synthetic)"
    for key in ("predictor", "label", "betas"):
        assert facts[key] == predicted[key]


def of_json(folder: Path) -> dict:
    return json.loads((folder / "about.json").read_text())


def of_npz(path: Path) -> dict:
    with np.load(path, allow_pickle=False) as stored:
        texts = {key: str(stored[key]) for key in ("model", "predictor", "label", "controls")}
        betas = stored["betas"].tolist()
    return texts | {"controls": json.loads(texts["controls"]), "betas": betas}


def of_glb(path: Path) -> dict:
    with path.open("rb") as file:
        (length,) = struct.unpack("<12xI4x", file.read(20))
        return json.loads(file.read(length))["asset"]["extras"]["dsnet"]


def of_abc(path: Path) -> dict:
    from alembic3d import Abc

    return json.loads(Abc.GetArchiveInfo(Abc.IArchive(str(path)))["userDescription"])


def of_usd(path: Path) -> dict:
    from pxr import Usd

    stage = Usd.Stage.Open(str(path))
    return json.loads(stage.GetRootLayer().customLayerData["dsnet"])
