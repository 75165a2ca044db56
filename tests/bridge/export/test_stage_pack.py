"""`dsnet pack` and `dsnet unpack`: an artifact in a file, and back."""

from __future__ import annotations

import numpy as np
import pytest

from bridge.cli import main
from bridge.exchange.packed import open_packed
from bridge.runs import read_artifact
from bridge.runs.writer import ArtifactWriter


@pytest.fixture
def folder(tmp_path):
    """An alignment of (200, 9, 3) offsets, with a file that is no array."""
    writer = ArtifactWriter(tmp_path / "align", "align", data="synthetic")
    turns = np.arange(200)[:, None, None] / 10 + np.arange(27).reshape(9, 3)
    writer.put("offsets", (0.02 * np.sin(turns)).astype(np.float32), "m")
    writer.put("theta", np.cos(turns[:, :, 0]), "rad, last three m")
    writer.put("nothing", np.zeros((0, 9, 3), np.float32), "m")
    writer.file_path("notes.txt").write_text("text")
    writer.record(sequences=[{"name": "a"}])
    writer.finish(config={"steps": 3})
    return tmp_path / "align"


def run(*arguments):
    main([str(argument) for argument in arguments])


def refused(capsys, *arguments):
    capsys.readouterr()
    with pytest.raises(SystemExit) as stopped:
        run(*arguments)
    printed = capsys.readouterr().err
    assert stopped.value.code == 2
    assert printed.count("\n") == 1, printed
    return printed


def test_there_and_back(folder, tmp_path, capsys):
    run("pack", "--folder", folder, "--out", tmp_path / "a.npz", "--bound-mm", "0.05")
    told = capsys.readouterr().err
    assert "notes.txt" in told
    assert "to 1" in told
    run("unpack", "--file", tmp_path / "a.npz", "--out", tmp_path / "back")
    before, after = read_artifact(folder), read_artifact(tmp_path / "back", "unpacked")
    after.verify()
    assert after.origin == "synthetic"
    assert after.manifest["packed"]["source_sha256"] == before.content_sha256
    assert after.manifest["packed"]["manifest"] == {"sequences": [{"name": "a"}]}
    assert after.manifest["bounds_m"] == {"offsets": 5e-5}
    assert np.abs(after.array("offsets") - before.array("offsets").astype(float)).max() <= 5e-5
    for name in ("theta", "nothing"):
        np.testing.assert_array_equal(after.array(name), before.array(name))


def test_unpacking_again_replaces_what_was_unpacked(folder, tmp_path):
    run("pack", "--folder", folder, "--out", tmp_path / "a.npz")
    for _ in range(2):
        run("unpack", "--file", tmp_path / "a.npz", "--out", tmp_path / "back")
    with open_packed(tmp_path / "a.npz") as packed:
        expected = packed.array("offsets")
    np.testing.assert_array_equal(read_artifact(tmp_path / "back").array("offsets"), expected)


def test_refusals_leave_nothing(folder, tmp_path, capsys):
    out = tmp_path / "a.npz"
    assert "--folder" in refused(capsys, "pack", "--out", out)
    assert "--out" in refused(capsys, "pack", "--folder", folder)
    assert ".npz" in refused(capsys, "pack", "--folder", folder, "--out", tmp_path / "a.zip")
    assert "bound" in refused(
        capsys, "pack", "--folder", folder, "--out", out, "--bound-mm", "1e-9"
    )
    for bound in ("0", "-1", "nan"):
        options = "--folder", folder, "--out", out, f"--bound-mm={bound}"
        assert "--bound-mm" in refused(capsys, "pack", *options)
    assert "manifest" in refused(capsys, "pack", "--folder", tmp_path, "--out", out)
    assert "without --file" in refused(capsys, "unpack", "--out", tmp_path / "back")
    assert not out.exists()
    out.write_bytes(b"something of mine")
    assert "exists" in refused(capsys, "pack", "--folder", folder, "--out", out)
    back = tmp_path / "back"
    assert "does not unpack" in refused(capsys, "unpack", "--file", out, "--out", back)
    assert "other files" in refused(capsys, "unpack", "--file", packed(folder), "--out", tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"align", "a.npz", "packed.npz"}


def packed(folder):
    out = folder.parent / "packed.npz"
    run("pack", "--folder", folder, "--out", out)
    return out
