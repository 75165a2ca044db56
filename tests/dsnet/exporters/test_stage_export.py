"""`dsnet export`: one line for a mistake, all or nothing, and no more memory for more frames."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import weakref
from pathlib import Path

import numpy as np
import pytest

from dsnet.cli import main
from dsnet.exporters.formats import FORMATS, Format
from dsnet.exporters.output import new_path
from dsnet.prediction.moving_body import MovingBody
from tests.dsnet.exporters.conftest import moving_body
from tests.forged.amass import save, smplh
from tests.pages import python_blocks


@pytest.fixture
def motion(tmp_path: Path) -> Path:
    """An AMASS file of 3 frames at 60 fps."""
    return save(tmp_path / "given" / "a_poses.npz", smplh(3, 60.0), source="synthetic")


@pytest.fixture
def refused(motion, tmp_path, refusal):
    """Export, and see that one line is all that happens."""

    def run(*options: str) -> str:
        before = sorted(tmp_path.rglob("*"))
        printed = refusal("export", *options)
        assert sorted(tmp_path.rglob("*")) == before
        return printed

    return run


@pytest.mark.parametrize("to", ["npz", "pc2"])
def test_a_file_or_a_folder_and_nothing_beside_it(motion, tmp_path, capsys, to):
    out = tmp_path / "new" / f"body.{to}"
    main(["export", "--to", to, "--motion", str(motion), "--out", str(out)])
    assert [path.name for path in out.parent.iterdir()] == [out.name]
    assert out.is_dir() == FORMATS[to].is_folder
    assert "predicts" in capsys.readouterr().err


def test_betas_and_predictor_are_those_asked_for(motion, tmp_path, refused):
    out = tmp_path / "body.npz"
    betas = ",".join("1" * 10)
    options = ["--to", "npz", "--motion", str(motion), "--out", str(out)]
    main(["export", *options, "--betas", betas, "--predictor", "dsnet_plus"])
    with np.load(out) as stored:
        assert stored["betas"].tolist() == [1.0] * 10
    out.unlink()
    assert "dsnet_faithful" in refused(*options, "--predictor", "dsnet_faithful")
    assert "10 finite numbers" in refused(*options, "--betas", "1,2")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("", "--to"),
        ("--to npz --motion {motion}", "without --out"),
        ("--to npz --out {out}.npz", "without --motion"),
        ("--to npz --motion no.npz --out {out}.npz", "does not exist"),
        ("--to fbx --motion {motion} --out {out}", "one of onnx, onnx-clip, onnx-plain, usd"),
        ("--to fbx --motion {motion} --out {out}", "glb or usd, and convert it in Blender"),
        ("--to usd --motion {motion} --out {out}", "ends in .usdz or .usd or .usdc or .usda"),
        ("--to usd --motion {motion} --out {out}.usd --precision int8", "--precision int8"),
        (
            "--to npz --motion {motion} --out {out}.npz --predictor dsnet_plus dsnet_faithful",
            "2 predictors; expected one predictor, or --to gif or mp4",
        ),
        (
            "--to gif --motion {motion} --out {out}.gif --predictor dsnet_plus dsnet_faithful",
            "dsnet_faithful",
        ),
    ],
)
def test_what_does_not_go_together_is_one_line(refused, motion, tmp_path, options, said):
    assert said in refused(*options.format(motion=motion, out=tmp_path / "body").split())


@pytest.mark.parametrize("to", ["usd", "mp4", "abc"])
def test_a_missing_extra_is_named(refused, motion, tmp_path, monkeypatch, to):
    monkeypatch.setattr("bridge.installation.find_spec", lambda name: None)
    out = tmp_path / f"body.{to}"
    printed = refused("--to", to, "--motion", str(motion), "--out", str(out))
    assert f'[{FORMATS[to].extra}]"' in printed.partition("pip install")[2]


def test_a_new_format_is_the_file_and_the_line_that_contributing_shows(
    motion, tmp_path, monkeypatch
):
    (block,) = [block for block in python_blocks("CONTRIBUTING.md") if "def write" in block]
    (tmp_path / "csv_export.py").write_text(block)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(FORMATS, "csv", Format("csv_export.write", (".csv",)))
    for to in ("csv", "npz"):
        out = str(tmp_path / f"body.{to}")
        main(["export", "--to", to, "--motion", str(motion), "--out", out])
    comment, *rows = (tmp_path / "body.csv").read_text().splitlines()
    assert comment.startswith("# synthetic data; dsnet")
    with np.load(tmp_path / "body.npz") as stored:
        assert [row.count(",") for row in rows] == [3 * 6890 - 1] * len(stored["theta"])


@pytest.mark.parametrize("kind", ["file", "folder", "link"])
def test_what_exists_stays(refused, motion, tmp_path, kind):
    out = tmp_path / "body.npz"
    if kind == "link":
        out.symlink_to(tmp_path / "nowhere")
    else:
        out.write_text("mine") if kind == "file" else out.mkdir()
    assert "which exists" in refused("--to", "npz", "--motion", str(motion), "--out", str(out))


def test_a_path_in_a_run_is_refused(refused, motion, tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))
    (tmp_path / "runs" / "r").mkdir(parents=True)
    out = tmp_path / "runs" / "r" / "predict"
    assert "in a run" in refused("--to", "pc2", "--motion", str(motion), "--out", str(out))


@pytest.mark.parametrize("place", ["given/a_poses.npz/x.npz", "/proc/x.npz"])
def test_a_place_where_nothing_can_be_made(refused, motion, tmp_path, place):
    out = tmp_path / place
    assert "cannot be written" in refused("--to", "npz", "--motion", str(motion), "--out", str(out))


def test_an_interrupt_leaves_nothing(motion, tmp_path, monkeypatch):
    def interrupted(path, moving):
        (path / "body.pc2").write_bytes(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr("dsnet.exporters.mesh_files.write_pc2", interrupted)
    out = tmp_path / "out"
    with pytest.raises(SystemExit) as stopped:
        main(["export", "--to", "pc2", "--motion", str(motion), "--out", str(out)])
    assert stopped.value.code == 130
    assert not list(tmp_path.glob("*out*"))
    assert not list(tmp_path.glob(".*out*"))


def test_what_a_killed_process_left_is_no_hindrance(tmp_path):
    (tmp_path / ".body.npz.partial").mkdir()
    (tmp_path / ".body.npz.partial" / "body.npz").write_text("half")
    with new_path(tmp_path / "body.npz") as path:
        assert not path.exists()
        path.write_text("whole")
    assert [path.name for path in tmp_path.iterdir()] == ["body.npz"]


@pytest.mark.parametrize("to", ["usd", "abc", "glb"])
def test_a_name_that_is_not_utf_8_is_a_file_or_one_line(motion, tmp_path, to, capfd):
    out = tmp_path / f"a\udcff.{to}"
    with contextlib.suppress(SystemExit):
        main(["export", "--to", to, "--motion", str(motion), "--out", str(out)])
    said = capfd.readouterr().err
    assert "Traceback" not in said
    assert out.exists() or "expected a path in UTF-8" in said


def test_two_processes_and_one_path(motion, tmp_path):
    out = tmp_path / "body.npz"
    options = ["export", "--to", "npz", "--motion", str(motion), "--out", str(out)]
    code = "from dsnet.cli import main; main()"
    with new_path(out) as path:
        command = [sys.executable, "-c", code, *options]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ)
        path.write_text("first")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "another process" in done.stderr
    assert out.read_text() == "first"


@pytest.mark.parametrize("to", ["npz", "pc2", "mdd", "ply", "usd"])
def test_pieces_do_not_stay_in_memory(character, tmp_path, monkeypatch, to):
    monkeypatch.setattr("dsnet.prediction.models.FRAMES_AT_ONCE", 2)
    moving, alive = Watched.of(moving_body(character, 12)), []
    moving.alive = alive
    path = tmp_path / f"body{(FORMATS[to].suffixes or ('',))[0]}"
    if FORMATS[to].is_folder:
        path.mkdir()
    FORMATS[to].writer()(path, moving)
    assert len(alive) >= 6
    assert max(alive) <= 2


class Watched(MovingBody):
    """Counts the pieces that are still held by somebody when the next one is made."""

    alive: list[int]

    @classmethod
    def of(cls, moving: MovingBody) -> Watched:
        return cls(moving.trained, moving.motion)

    def __iter__(self):
        given = []
        for posed in super().__iter__():
            self.alive.append(sum(reference() is not None for reference in given) + 1)
            given.append(weakref.ref(posed.vertices_m))
            yield posed
