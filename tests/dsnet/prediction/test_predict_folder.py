"""A folder of motions: the tree of their predictions, whatever happens on the way."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body import load_body_model
from bridge.runs import read_artifact
from dsnet.cli import main
from dsnet.prediction import predict_folder as folders
from dsnet.prediction.controls import Controls
from dsnet.prediction.folder_job import FolderJob
from dsnet.prediction.predict_folder import REFUSED
from dsnet.prediction.prediction_files import predict_motion
from dsnet.prediction.stage_predict import what_to_write
from tests.forged.amass import save, shape, smplh
from tests.forged.many_motions import forge, tree

EMBEDDED = Path("embedded")
predict_folder = partial(folders.predict_folder, controls=Controls(body=EMBEDDED))
DSNET = "from dsnet.cli import main; main()"
IN_ONE_PROCESS = (
    "import dsnet.prediction.predict_folder as m; m.on_any_node = lambda kind: 'serial'; "
)


@pytest.fixture(autouse=True)
def one_process(request, monkeypatch) -> None:
    """Processes take seconds to begin: those that are not looked at are left out."""
    if "slow" not in request.keywords:
        monkeypatch.setattr(folders, "on_any_node", lambda kind: "serial")


@pytest.fixture
def given(tmp_path) -> Path:
    return forge(tmp_path / "given", 5)


def test_the_tree_is_the_motions_and_holds_what_each_alone_gives(given, tmp_path, capsys):
    out = tmp_path / "out"
    main(["predict", "--motion", str(given), "--body", "embedded", "--out", str(out)])
    said = capsys.readouterr().err.splitlines()
    assert said[0].startswith("dsnet: moves embedded:female and embedded:male")
    assert said[0].endswith("of 5 of 5 motions the betas are not used")
    assert said[1].startswith("dsnet: 0 motions are done, 5 of 60 frames to do: 5.0 MB to write,")
    assert said[2] == "dsnet: of 5 there are warnings, under `told` in their manifest.json"
    assert said[3:] == [f"dsnet: 5 motions are in {out}"]
    names = {path.parent.relative_to(out).as_posix() for path in out.rglob("manifest.json")}
    assert names == {f"Set{n % 2}/{n % 3:02d}/{n:03d}_poses" for n in range(5)}
    for number in (0, 1):  # a woman, a man
        name = f"Set{number}/{number:02d}/{number:03d}_poses"
        made = read_artifact(out / name, "prediction")
        made.verify()
        assert "betas" in made.manifest["told"][0]
        assert set(made.digests) == {"offsets.npy", "theta.npy"}
        alone = predict_motion(None, given / f"{name}.npz", tmp_path / "alone", write=["offsets"])
        np.testing.assert_array_equal(made.array("offsets"), alone.array("offsets"))
        assert np.abs(made.array("offsets")).max() > 1e-4


def test_what_is_done_is_not_done_again(given, tmp_path, capsys):
    out = tmp_path / "out"
    predict_folder(None, given, out)
    first = {path: path.stat().st_mtime_ns for path in out.rglob("*.npy")}
    left = out / "Set1" / "01" / ".001_poses.partial"  # of a process killed when it was done
    left.mkdir()
    (left / "lock").touch()
    save(given / "Set0" / "00" / "000_poses.npz", smplh(7, 60.0))
    capsys.readouterr()
    predict_folder(None, given, out)
    assert "4 motions are done, 1 of 7 frames to do" in capsys.readouterr().err
    assert not left.exists()
    again = {path: path.stat().st_mtime_ns for path in out.rglob("*.npy")}
    changed = {str(path.parent.relative_to(out)) for path in first if first[path] != again[path]}
    assert changed == {"Set0/00/000_poses"}
    predict_folder(None, given, out, write=["offsets16", "vertices"])
    made = read_artifact(out / "Set0" / "00" / "000_poses")
    assert "0 motions are done" in capsys.readouterr().err
    assert made.array("offsets").dtype == np.float16
    assert made.array("vertices").shape == (7, 6890, 3)


def test_a_bad_file_in_the_middle_stops_no_other(given, tmp_path, capsys):
    whole = (given / "Set1" / "01" / "001_poses.npz").read_bytes()
    (given / "Set1" / "01" / "001a_poses.npz").write_bytes(whole[: len(whole) // 2])
    save(given / "Set1" / "01" / "001b_poses.npz", smplh(), trans=np.full((5, 3), 2e4))
    out = tmp_path / "out"
    with pytest.raises(SystemExit) as stopped:
        main(["predict", "--motion", str(given), "--body", "embedded", "--out", str(out)])
    said = capsys.readouterr().err.splitlines()
    assert stopped.value.code == 2
    assert "2 of 7 files, refused as listed above" in said[-1]
    assert [line.split()[1].strip(",:") for line in said[3:5]] == [
        "Set1/01/001a_poses.npz",
        "Set1/01/001b_poses.npz",
    ]
    assert [f"dsnet: {line}" for line in (out / REFUSED).read_text().splitlines()] == said[3:5]
    assert len(list(out.rglob("offsets.npy"))) == 5
    for name in "ab":
        (given / "Set1" / "01" / f"001{name}_poses.npz").unlink()
    predict_folder(None, given, out)
    assert not (out / REFUSED).exists()


def test_files_of_one_name_and_beside_a_folder_of_theirs_have_a_folder_each(tmp_path):
    folder, out = tmp_path / "given", tmp_path / "out"
    for name in ("a.npz", "S1.npz", "S1/walk.npz", "refused.txt.npz"):
        save(folder / name, smplh(4, 60.0))
    (folder / "a.smpl").write_bytes((folder / "a.npz").read_bytes())
    for _ in range(2):
        predict_folder(None, folder, out)
    made = {path.parent.relative_to(out).as_posix() for path in out.rglob("manifest.json")}
    assert made == {"a.npz", "a.smpl", "S1.npz", "S1/walk", "refused.txt.npz"}


def test_markers_that_come_beside_a_motion_make_another_prediction(tmp_path, capsys):
    path, out = save(tmp_path / "given" / "jacks_poses.npz", smplh(4, 60.0)), tmp_path / "out"
    controls = Controls(body=EMBEDDED, betas="0" + ",0" * 9)
    for text in (None, b"", b"others"):
        if text is not None:
            path.with_name("jacks.c3d").write_bytes(text)
        predict_folder(None, path.parent, out, controls=controls)
        assert "dsnet: 0 motions are done" in capsys.readouterr().err
    predict_folder(None, path.parent, out, controls=controls)
    assert "dsnet: 1 motions are done" in capsys.readouterr().err


def test_another_body_is_another_prediction(given, tmp_path, capsys):
    """Told from one of the same name by its size or time: a file of one's own, or embedded."""
    load_body_model("embedded:male").save_smpl_npz(tmp_path / "mine.npz")
    for body in ("embedded:male", "embedded", tmp_path / "mine.npz"):
        predict_folder(None, given, tmp_path / "out", controls=Controls(body=Path(body)))
        assert "dsnet: 0 motions" in capsys.readouterr().err
    mine = Controls(body=tmp_path / "mine.npz")
    predict_folder(None, given, tmp_path / "out", controls=mine)
    assert "5 motions are done" in capsys.readouterr().err
    os.utime(tmp_path / "mine.npz", (0, 0))
    predict_folder(None, given, tmp_path / "out", controls=mine)
    assert "dsnet: 0 motions" in capsys.readouterr().err


def test_another_joint_map_is_another_prediction(tmp_path):
    controls, asked = Controls(joint_map=tmp_path / "joints.txt"), []
    for knee in ("LeftLeg", "Bip01 L Calf"):
        (tmp_path / "joints.txt").write_text(f"left_knee = {knee}\n")
        asked.append(FolderJob(None, None, controls, ("vertices",), tmp_path).config)
    assert asked[0] != asked[1]


@pytest.mark.parametrize(
    ("out", "words"),
    [("given/out", "lies in --motion"), ("runs/r", "a place in the runs"), ("one", "a prediction")],
)
def test_a_folder_where_it_would_do_harm_is_refused(given, tmp_path, monkeypatch, out, words):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "manifest.json").write_text("{}")
    with pytest.raises(DsnetError, match=words):
        predict_folder(None, given, tmp_path / out)


def test_a_folder_without_motions_is_refused(tmp_path):
    save(tmp_path / "given" / "shape.npz", shape())
    with pytest.raises(DsnetError, match="a folder with 1 files that might be motions"):
        predict_folder(None, tmp_path / "given", tmp_path / "out")


def test_a_disk_without_room_is_refused_before_anything_is_written(given, tmp_path, monkeypatch):
    usage = folders.shutil.disk_usage(tmp_path)._replace(free=1_000_000)
    monkeypatch.setattr(folders.shutil, "disk_usage", lambda path: usage)
    with pytest.raises(DsnetError, match=r"1\.0 MB free; expected 5\.0 MB for 60 frames"):
        predict_folder(None, given, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_disk_that_fills_meanwhile_is_no_fault_of_a_motion(given, tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("bridge.runs.files.os.posix_fallocate", full)
    with pytest.raises(DsnetError, match="cannot be written"):
        predict_folder(None, given, tmp_path / "out")


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ("ofsets", "Did you mean 'offsets'"),
        ("offsets,offsets16", "one of these"),
        ("strip", "it with offsets and vertices"),
    ],
)
def test_what_cannot_be_written_is_refused(asked, words):
    with pytest.raises(DsnetError, match=words):
        what_to_write([asked], Path("motions"))


def killed_and_resumed(given: Path, out: Path, seconds: list[float], code: str = DSNET) -> int:
    """Kill the command after so many seconds each, then let it end; how many kills came in time."""
    command, kills = [sys.executable, "-c", code, "predict", "--motion", str(given)], 0
    command += ["--body", "embedded", "--out", str(out)]
    for pause in seconds:
        process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        while process.poll() is None and not list(out.rglob("offsets.npy")):
            time.sleep(0.01)
        time.sleep(pause)
        process.send_signal(signal.SIGKILL)
        kills += process.wait() == -signal.SIGKILL
    subprocess.run(command, check=True, capture_output=True)
    return kills


@pytest.mark.slow
def test_sixty_motions_killed_and_resumed_have_equal_bytes(tmp_path):
    given = forge(tmp_path / "given", 60, 30)
    predict_folder(None, given, tmp_path / "whole")
    assert killed_and_resumed(given, tmp_path / "killed", [0.3, 2.0]) >= 1
    whole = tree(tmp_path / "whole")
    assert len(whole) == 180
    assert tree(tmp_path / "killed") == whole


def test_a_killed_one_goes_on_to_equal_bytes(given, tmp_path):
    predict_folder(None, given, tmp_path / "whole")
    code = IN_ONE_PROCESS + DSNET
    assert killed_and_resumed(given, tmp_path / "killed", [0.0], code) == 1
    assert tree(tmp_path / "killed") == tree(tmp_path / "whole")
