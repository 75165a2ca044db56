"""What Windows and macOS lack is done without, as far as that can be tried on Linux."""

from __future__ import annotations

import ast
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bridge.runs import read_artifact
from tests.forged.amass import save, smplh
from tests.sources import PACKAGES, ROOT, parsed, source_files

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
PREDICTS = "from bridge.cli import main; main(sys.argv[1:])"
LOCKS = """
from pathlib import Path
from bridge.processes import exit_with_one_line
from bridge.runs import files
assert files.fcntl is None
with exit_with_one_line(), files.exclusive(Path(sys.argv[1]), "a folder", "Wait."):
    print("alone", flush=True)
    sys.stdin.read()
"""
WRITES = """
from pathlib import Path
import numpy as np
from bridge.runs import ArtifactWriter, artifact
assert artifact.resource is None
writer = ArtifactWriter(Path(sys.argv[1]), "toy", data="synthetic")
def fill():
    rows = np.arange(4_000_000, dtype="f4").reshape(1000, 4000)
    file = writer.array_file("x", rows.shape, "f4", "m")
    file.write(0, rows[:700])
    file.write(700, rows[700:])
    writer.open_array("none", (0, 3), "f4", "m")
    writer.put("y", rows[:2], "m")
fill()
writer.finish()
"""


def opens_text(call: ast.Call) -> bool:
    """Whether a call reads or writes text, by its name and mode."""
    if isinstance(call.func, ast.Name) and call.func.id == "open":
        mode = call.args[1] if len(call.args) > 1 else ast.Constant("r")
        return not isinstance(mode, ast.Constant) or "b" not in str(mode.value)
    if "metadata" in ast.unparse(call.func):  # of a distribution, always UTF-8
        return False
    return getattr(call.func, "attr", "") in ("read_text", "write_text")


def test_no_text_file_depends_on_the_locale():
    """What is read or written is UTF-8 on every system."""
    found = [
        f"{path}:{call.lineno}"
        for path in source_files(*PACKAGES, "benchmarks", "examples", "tools")
        for call in ast.walk(parsed(path))
        if isinstance(call, ast.Call)
        and opens_text(call)
        and "encoding" not in {keyword.arg for keyword in call.keywords}
    ]
    assert not found


def begun(code: str, *arguments: object) -> subprocess.Popen[str]:
    """A process on that platform."""
    command = [sys.executable, "-X", "warn_default_encoding", "-m", "tests.without_posix", code]
    pipe = subprocess.PIPE
    return subprocess.Popen(
        [*command, *map(str, arguments)], cwd=ROOT, stdin=pipe, stdout=pipe, stderr=pipe, text=True
    )


def done(code: str, *arguments: object) -> tuple[str, int]:
    """What it said on stderr, and its exit status."""
    process = begun(code, *arguments)
    return process.communicate()[1], process.returncode


def test_a_motion_moves(tmp_path: Path):
    given = {"gender": "female", "source": "synthetic"}
    motion, out = save(tmp_path / "a_poses.npz", smplh(12, 60.0), **given), tmp_path / "out"
    said, status = done(PREDICTS, "predict", "--motion", motion, "--out", out)
    assert (status, said.count("\n")) == (0, 1), said
    assert np.isfinite(read_artifact(out, "prediction").array("vertices")).all()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a_poses.npz", "out"]


def test_an_artifact_is_written_and_replaced(tmp_path: Path):
    for _ in range(2):
        assert done(WRITES, tmp_path / "a") == ("", 0)
    made = read_artifact(tmp_path / "a", "toy")
    np.testing.assert_array_equal(made.array("x").ravel(), np.arange(4_000_000, dtype=np.float32))
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


@pytest.mark.parametrize("how", ["ended", "killed"])
def test_a_lock_keeps_others_out_until_its_owner_ends(how: str, tmp_path: Path):
    with begun(LOCKS, tmp_path / "a") as first:
        try:
            assert first.stdout is not None
            assert first.stdout.readline() == "alone\n"
            said, status = done(LOCKS, tmp_path / "a")
            assert (status, said.count("\n")) == (2, 1), said
            assert "a folder, which another process is making" in said
            if how == "killed":
                first.send_signal(signal.SIGKILL)
            assert first.communicate()[1] == ""
        finally:
            first.kill()
    assert done(LOCKS, tmp_path / "a") == ("", 0)
    assert not list(tmp_path.iterdir())
