"""`dsnet predict --motion M --out DIR` writes where nothing of anybody else's can be lost."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bridge.cli import main
from bridge.runs import read_artifact
from bridge.runtime.stage_predict import open_out_folder

PREDICT = "from bridge.cli import main; main()"


def files_below(folder: Path) -> dict[str, bytes]:
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {str(path): path.read_bytes() for path in files if ".digests" not in path.parts}


@pytest.fixture
def refused(trained_run, motion, tmp_path, capsys):
    """Predict to a folder, and see that one line is all that happens."""

    def run(out: Path, *options: str) -> str:
        before = files_below(tmp_path)
        capsys.readouterr()
        arguments = ["predict", "--run", "r", "--motion", str(motion), "--out", str(out)]
        with pytest.raises(SystemExit) as stopped:
            main([*arguments, *options])
        printed = capsys.readouterr().err
        assert stopped.value.code == 2
        assert printed.count("\n") == 1, printed
        assert files_below(tmp_path) == before
        return printed

    return run


def test_a_stage_of_a_run_stays(refused, trained_run):
    assert "train-ae" in refused(trained_run.path / "train-ae")
    assert "run" in refused(trained_run.path / "predict")


def test_a_stage_copied_elsewhere_stays(refused, trained_run, tmp_path):
    """What a folder's name says is not asked: its manifest is."""
    shutil.copytree(trained_run.path / "train", tmp_path / "copy")
    np.save(tmp_path / "copy" / "latents.npy", np.zeros(3))
    assert "kind 'train'" in refused(tmp_path / "copy")


def test_a_folder_of_the_users_own_stays(refused, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("mine")
    np.save(tmp_path / "mine" / "latents.npy", np.zeros(3))
    assert "holds other files" in refused(tmp_path / "mine")


@pytest.mark.usefixtures("blank_strip")
@pytest.mark.parametrize("name", ["notes.txt", "sub/notes.txt", ".notes"])
def test_a_users_file_beside_an_earlier_prediction_stays(
    trained_run, motion, refused, tmp_path, name
):
    out = tmp_path / "out"
    main(["predict", "--run", "r", "--motion", str(motion), "--out", str(out)])
    (out / name).parent.mkdir(exist_ok=True)
    (out / name).write_text("mine")
    assert Path(name).name in refused(out)


@pytest.mark.usefixtures("blank_strip")
def test_an_earlier_prediction_is_replaced(trained_run, motion, tmp_path):
    out = tmp_path / "new" / "out"
    command = ["predict", "--run", "r", "--motion", str(motion), "--out", str(out)]
    main(command)
    first = read_artifact(out, "prediction")
    main([*command, "--betas", ",".join("1" * 10)])
    second = read_artifact(out, "prediction")
    second.verify()
    assert second.manifest["betas"] == [1.0] * 10 != first.manifest["betas"]
    assert [path.name for path in out.parent.iterdir()] == ["out"]


@pytest.mark.parametrize("place", ["file", "file/x", "file/x/y"])
def test_a_path_through_a_file_is_one_line(refused, tmp_path, place):
    (tmp_path / "file").write_text("mine")
    assert "--out" in refused(tmp_path / place)


def test_a_place_where_nothing_can_be_made_is_one_line(refused):
    assert "--out /proc/x" in refused(Path("/proc/x"))


def test_two_predictions_into_one_folder(trained_run, motion, tmp_path):
    """One of them writes it, whole; who comes meanwhile is told so in one line."""
    out = tmp_path / "out"
    command = [sys.executable, "-c", PREDICT, "predict", "--run", "r"]
    options = ["--motion", str(motion), "--out", str(out)]
    started = [
        subprocess.Popen([*command, *options], stderr=subprocess.PIPE, text=True, env=os.environ)
        for _ in range(3)
    ]
    ended = [(process.communicate()[1], process.returncode) for process in started]
    assert {status for _, status in ended} <= {0, 2}
    assert any(status == 0 for _, status in ended)
    for printed, status in ended:
        assert printed.count("\n") == 1, printed
        assert status == 0 or "another process" in printed
    read_artifact(out, "prediction").verify()
    assert [path.name for path in tmp_path.iterdir() if "out" in path.name] == ["out"]


def test_a_folder_that_is_being_written_is_not_taken(trained_run, motion, tmp_path):
    out = tmp_path / "out"
    command = [sys.executable, "-c", PREDICT, "predict", "--run", "r"]
    options = ["--motion", str(motion), "--out", str(out)]
    with open_out_folder(out, "synthetic") as writer:
        writer.put("latents", np.zeros(3), "1")
        done = subprocess.run([*command, *options], capture_output=True, text=True, check=False)
        writer.finish()
    assert done.returncode == 2
    assert "another process" in done.stderr
    assert done.stderr.count("\n") == 1, done.stderr
    np.testing.assert_array_equal(read_artifact(out, "prediction").array("latents"), np.zeros(3))
    assert not list(tmp_path.glob(".out*"))
