"""Artifacts that no stage wrote: forged manifests and arrays are refused in one line."""

from __future__ import annotations

import hashlib
import io
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bridge import DsnetError
from bridge.motion.sequences import sequences_of
from bridge.runs import Run, read_artifact, write_artifact
from bridge.runs.artifact import content_digest

Manifest = dict[str, Any]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    path = tmp_path / "align"
    write_artifact(path, "align", {"a": np.arange(6.0)}, units={"a": "m"}, data="synthetic")
    return path


def forge(folder: Path, change: Callable[[Manifest], object]) -> None:
    """Change the manifest and sign it again."""
    path = folder / "manifest.json"
    manifest = json.loads(path.read_text())
    change(manifest)
    manifest["sha256"] = content_digest(manifest)
    path.write_text(json.dumps(manifest))


@pytest.mark.parametrize(
    ("change", "key"),
    [
        (lambda m: m.update(arrays=None), "arrays"),
        (lambda m: m.update(data="x"), "data"),
        (lambda m: m["arrays"]["a"].pop("shape"), "arrays"),
        (lambda m: m["arrays"]["a"].pop("dtype"), "arrays"),
        (lambda m: m["arrays"]["a"].update(dtype="O"), "arrays"),
        (lambda m: m["arrays"]["a"].update(dtype="no type"), "arrays"),
        (lambda m: m["arrays"]["a"].update(shape=[-1]), "arrays"),
        (lambda m: m["arrays"]["a"].pop("sha256"), "arrays"),
        (lambda m: m["arrays"].update({"../a": m["arrays"]["a"]}), "arrays"),
        (lambda m: m["files"].update({"../x": {"sha256": ""}}), "files"),
        (lambda m: m["files"].update({"/etc/passwd": {"sha256": ""}}), "files"),
        (lambda m: m["files"].update({"a\n\x1b[2J": {"sha256": ""}}), "files"),
        (lambda m: m["upstream"].update({"../../x": ""}), "upstream"),
        (lambda m: m["upstream"].update({"x": 5}), "upstream"),
        (lambda m: m["provenance"].update(inputs=[1]), "provenance"),
        (lambda m: m["provenance"].update(sha256=1), "provenance"),
        (lambda m: m["provenance"].update(sha256=[]), "provenance"),
        (lambda m: m["provenance"].update(stamps=[]), "provenance"),
        (lambda m: m.update(sequences={}), "sequences"),
        (lambda m: m.update(predictors=["a"]), "predictors"),
        (lambda m: m.update(predictors={"../a": {}}), "predictors"),
    ],
)
def test_manifests_that_no_stage_wrote_are_refused(
    folder: Path, change: Callable[[Manifest], object], key: str
) -> None:
    forge(folder, change)
    with pytest.raises(DsnetError, match=f"whose '{key}' no stage wrote") as caught:
        read_artifact(folder)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("make", [os.mkfifo, lambda path: path.symlink_to("/dev/zero")])
def test_a_manifest_that_is_no_file_is_refused_at_once(
    folder: Path, make: Callable[[Path], None]
) -> None:
    (folder / "manifest.json").unlink()
    make(folder / "manifest.json")
    with pytest.raises(DsnetError, match=r"has no manifest\.json"):
        read_artifact(folder)


def _archive() -> bytes:
    stream = io.BytesIO()
    np.savez(stream, a=np.arange(6.0))
    return stream.getvalue()


@pytest.mark.parametrize(
    "change",
    [
        lambda content: content.replace(b"(6,)", b"{6,)"),
        lambda content: content.replace(b"(6,)", b"(9,)"),
        lambda content: content.replace(b"<f8", b"|O "),
        lambda content: content.replace(b"<f8", b"<i8"),
        lambda content: content[:-1],
        lambda _: _archive(),
        lambda _: b"",
    ],
)
def test_arrays_that_are_not_what_the_manifest_says_are_refused(
    folder: Path, change: Callable[[bytes], bytes]
) -> None:
    content = change((folder / "a.npy").read_bytes())
    (folder / "a.npy").write_bytes(content)
    digest = hashlib.sha256(content).hexdigest()
    forge(folder, lambda m: m["arrays"]["a"].update(sha256=digest))
    with pytest.raises(DsnetError, match=r"does not hold what manifest\.json says"):
        read_artifact(folder).array("a")


@pytest.mark.parametrize("entry", [{}, {"name": 5}, {"nam": "x"}])
def test_sequences_that_are_none_are_refused(folder: Path, entry: Manifest) -> None:
    forge(folder, lambda m: m.update(sequences=[entry]))
    with pytest.raises(DsnetError, match="no list of sequences"):
        sequences_of(read_artifact(folder))
    forge(folder, lambda m: m.pop("sequences"))
    with pytest.raises(DsnetError, match="without 'sequences'"):
        sequences_of(read_artifact(folder))


def test_a_stage_that_was_made_from_itself_is_refused(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DSNET_RUNS", str(folder.parents[1]))
    forge(folder, lambda m: m["upstream"].update(align="0"))
    with pytest.raises(DsnetError, match="made from itself"):
        Run(folder.parent.name).check_chain(["align"])
