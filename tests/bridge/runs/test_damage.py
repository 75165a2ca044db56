"""Only what a damaged file can cause is called damage, and one module says what that is."""

from __future__ import annotations

import ast
import errno
import zlib
from pathlib import Path

import numpy as np
import pytest
from safetensors import SafetensorError

from bridge.errors import DsnetError
from bridge.exchange.checkpoints import load_checkpoint, save_checkpoint
from bridge.motion.readers import amass
from bridge.runs import read_artifact, write_artifact
from bridge.runs.damage import damage_refused
from bridge.runs.storage import map_array
from tests.sources import PACKAGES, ROOT, parsed, source_files

# What answers for work, not for a file: a thread that must live, an engine that is compared.
ANSWERS_FOR_WORK = {
    "bridge/view/performances.py",
    "bridge/verify/protocol.py",
    "tf_dsnet/framework.py",
}


def refused(error: Exception) -> DsnetError:
    return DsnetError(f"a file ({error})", "another", "Delete it.")


@pytest.mark.parametrize("error", [zlib.error("x"), KeyError("x"), EOFError(), SafetensorError()])
def test_what_a_file_can_cause_is_refused(error):
    with pytest.raises(DsnetError, match="Delete it"), damage_refused(refused, SafetensorError):
        raise error


@pytest.mark.parametrize(
    "error",
    [
        SystemError("AST constructor recursion depth mismatch"),
        MemoryError(),
        RecursionError(),
        ImportError(),
        KeyboardInterrupt(),
        OSError(errno.EMFILE, "Too many open files"),
        DsnetError("received", "expected", "remedy"),
    ],
)
def test_anything_else_passes(error):
    with pytest.raises(type(error)) as caught, damage_refused(refused):
        raise error
    assert caught.value is error


def test_a_machine_without_files_to_open_damages_none(tmp_path):
    resource = pytest.importorskip("resource")
    rows = {"x": np.zeros(3)}
    write_artifact(tmp_path / "a", "k", rows, units={"x": "m"}, data="synthetic")
    save_checkpoint(tmp_path / "c", rows)
    map_array(tmp_path / "y.npy", (3,), np.float64)[:] = 1
    motion = ROOT / "bridge" / "motion" / "samples" / "walking.npz"
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (0, before[1]))
    try:
        for work in (
            lambda: read_artifact(tmp_path / "a"),
            lambda: load_checkpoint(tmp_path / "c"),
            lambda: map_array(tmp_path / "y.npy", (3,), np.float64),
            lambda: amass.read(motion),
        ):
            with pytest.raises(OSError, match="Too many open files"):
                work()
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
    assert (map_array(tmp_path / "y.npy", (3,), np.float64) == 1).all()


def handlers_of_anything(path: Path) -> list[str]:
    """Where a file catches `Exception`, or all, and goes on."""
    handlers = [node for node in ast.walk(parsed(path)) if isinstance(node, ast.ExceptHandler)]
    broad = [
        one
        for one in handlers
        if one.type is None or {"Exception", "BaseException"} & set(ast.unparse(one.type).split())
    ]
    return [
        f"{path.relative_to(ROOT).as_posix()}:{one.lineno}"
        for one in broad
        if not (isinstance(one.body[-1], ast.Raise) and one.body[-1].exc is None)
    ]


def test_nobody_else_says_what_damage_is():
    found = [place for path in source_files(*PACKAGES) for place in handlers_of_anything(path)]
    assert {place.split(":")[0] for place in found} <= ANSWERS_FOR_WORK | {
        "bridge/runs/worker_pool.py",
        "bridge/plugins.py",
    }


def test_nobody_lets_numpy_parse_a_header():
    parsing = ("np.load(", "read_array(", "read_array_header", "NpzFile", "literal_eval")
    texts = {path: path.read_text(encoding="utf-8") for path in source_files(*PACKAGES)}
    found = {path for path, text in texts.items() if any(word in text for word in parsing)}
    assert not found
