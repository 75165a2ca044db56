"""Artifacts: what is written is read back, nothing half-written is seen, no forgery is taken."""

from __future__ import annotations

import hashlib
import io
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bridge import DsnetError
from bridge.motion.sequences import sequences_of
from bridge.runs import ArtifactWriter, Run, read_artifact, write_artifact
from bridge.runs.artifact import content_digest

UNITS = {"betas": "1", "offsets": "m"}


def small(path, seed=0):
    rng = np.random.default_rng(seed)
    arrays = {"betas": rng.normal(size=(2, 10)), "offsets": rng.normal(size=(3, 4, 3))}
    return arrays, write_artifact(path, "align", arrays, units=UNITS, data="synthetic", note="x")


def test_round_trip_maps_arrays_and_describes_them(tmp_path):
    arrays, _ = small(tmp_path / "align")
    artifact = read_artifact(tmp_path / "align", "align")
    for name, array in arrays.items():
        read = artifact.array(name)
        assert isinstance(read, np.memmap)
        np.testing.assert_array_equal(read, array)
        assert artifact.manifest["arrays"][name]["unit"] == UNITS[name]
    assert artifact.manifest["note"] == "x"
    assert artifact.origin == "synthetic"
    artifact.verify()


def test_content_digest_ignores_provenance_only(tmp_path):
    _, first = small(tmp_path / "a")
    _, second = small(tmp_path / "b")
    _, other = small(tmp_path / "c", seed=1)
    assert first.content_sha256 == second.content_sha256 != other.content_sha256


def test_verify_finds_one_changed_byte(tmp_path):
    _, artifact = small(tmp_path / "align")
    path = tmp_path / "align" / "offsets.npy"
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)
    with pytest.raises(DsnetError, match=r"offsets\.npy"):
        artifact.verify()


def test_an_unfinished_artifact_cannot_be_read(tmp_path):
    writer = ArtifactWriter(tmp_path / "align", "align", data="synthetic")
    writer.put("betas", np.zeros((2, 10)), "1")
    with pytest.raises(DsnetError, match="manifest"):
        read_artifact(tmp_path / "align")


def test_empty_arrays_are_kept(tmp_path):
    write_artifact(tmp_path / "a", "k", {"x": np.zeros((0, 3))}, units={"x": "m"}, data="synthetic")
    assert read_artifact(tmp_path / "a").array("x").shape == (0, 3)


@pytest.mark.parametrize(
    ("break_it", "word"),
    [
        (lambda p: (p / "manifest.json").write_text("{"), "JSON"),
        (lambda p: (p / "manifest.json").write_text("{}"), "schema"),
        (lambda p: (p / "manifest.json").write_text("[]"), "schema"),
        (lambda p: (p / "manifest.json").write_text("[" * 100_000), "JSON"),
        (lambda p: (p / "offsets.npy").unlink(), r"offsets\.npy with SHA-256 no file"),
        (lambda p: (p / "offsets.npy").write_bytes(b"\x93NUMPY"), r"offsets\.npy with SHA-256"),
        (lambda p: np.save(p / "offsets.npy", np.zeros(3)), r"offsets\.npy with SHA-256"),
    ],
)
def test_a_broken_artifact_is_one_line(tmp_path, break_it, word):
    small(tmp_path / "align")
    break_it(tmp_path / "align")
    with pytest.raises(DsnetError, match=word) as caught:
        read_artifact(tmp_path / "align").array("offsets")
    assert "\n" not in str(caught.value)


def test_wrong_kind_and_unknown_array_say_what_there_is(tmp_path):
    _, artifact = small(tmp_path / "align")
    with pytest.raises(DsnetError, match="kind 'align'"):
        read_artifact(tmp_path / "align", "train")
    with pytest.raises(DsnetError, match=r"\['betas', 'offsets'\]"):
        artifact.array("latents")


@dataclass(frozen=True)
class Config:
    run: str = "r"
    seed: int = 0


def build(config, calls, value=1.0, upstream=None):
    def make(writer):
        calls.append(config)
        writer.put("x", np.full(3, value), "m")

    return Run(config.run).build("stage", config, make, data="synthetic", upstream=upstream or {})


def test_a_current_stage_is_skipped_and_a_changed_one_is_made_again(tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    calls = []
    source = tmp_path / "input"
    source.write_text("a")
    for _ in range(2):
        build(Config(), calls, upstream={"input": source})
    assert len(calls) == 1
    build(Config(seed=1), calls, upstream={"input": source})
    source.write_text("b")
    build(Config(seed=1), calls, value=2.0, upstream={"input": source})
    assert len(calls) == 3
    np.testing.assert_array_equal(Run("r").artifact("stage").array("x"), 2.0)


@pytest.mark.parametrize("config", [Config(), Config(seed=9)])
def test_an_interrupted_stage_finds_its_checkpoints_only_with_the_same_inputs(
    config, tmp_path, monkeypatch
):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))

    def interrupted(writer):
        (writer.checkpoints / "frame").write_text("7")
        writer.array_file("x", (2,), np.float32, "m").write(0, [5])
        raise KeyboardInterrupt

    def resume(writer):
        seen.append((writer.checkpoints / "frame").exists())
        writer.array_file("x", (2,), np.float32, "m").write(1, [6])

    seen = []
    with pytest.raises(KeyboardInterrupt):
        Run("r").build("stage", Config(), interrupted, data="synthetic", upstream={})
    artifact = Run("r").build("stage", config, resume, data="synthetic", upstream={})
    assert seen == [config == Config()]
    assert artifact.array("x")[0] == (5 if config == Config() else 0)
    assert not (artifact.path / "checkpoints").exists()


def test_a_current_stage_leaves_another_configurations_checkpoints(tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    calls = []
    build(Config(), calls)

    def make(writer):
        kept = writer.checkpoints / "frame"
        if not kept.exists():
            kept.touch()
            raise KeyboardInterrupt
        writer.put("x", np.zeros(1), "m")

    with pytest.raises(KeyboardInterrupt):
        Run("r").build("stage", Config(seed=9), make, data="synthetic", upstream={})
    build(Config(), calls)
    assert len(calls) == 1
    made = Run("r").build("stage", Config(seed=9), make, data="synthetic", upstream={})
    assert made.array("x").shape == (1,)


def test_a_refused_input_leaves_nothing_behind(tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))

    def refuse(writer):
        writer.put("x", np.zeros(3), "m")
        raise DsnetError("a", "b", "c")

    with pytest.raises(DsnetError):
        Run("r").build("stage", Config(), refuse, data="synthetic", upstream={})
    assert not list((tmp_path / "r").iterdir())


def test_a_stage_is_made_by_one_process_at_a_time(tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    other = subprocess.Popen(
        [sys.executable, "-c", MAKING_FOR_EVER], stdout=subprocess.PIPE, stdin=subprocess.DEVNULL
    )
    with other:
        try:
            assert other.stdout is not None
            assert other.stdout.readline() == b"making\n"
            with pytest.raises(DsnetError, match=r"'stage' of run 'r', which another process"):
                build(Config(), [])
            assert (tmp_path / "r" / ".stage.partial" / "checkpoints" / "frame").exists()
        finally:
            other.kill()
    # What was killed holds nothing any more.
    assert build(Config(), []).array("x")[0] == 1.0


MAKING_FOR_EVER = """
import time
from dataclasses import make_dataclass
from bridge.runs import Run

def make(writer):
    (writer.checkpoints / "frame").write_text("7")
    print("making", flush=True)
    time.sleep(600)

Config = make_dataclass("Config", [("run", str, "r"), ("seed", int, 0)])
Run("r").build("stage", Config(), make, data="synthetic", upstream={})
"""


def test_unknown_run_names_the_known_ones(tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    build(Config(), [])
    with pytest.raises(DsnetError, match=r"unknown run 'nope' \(known: r\)"):
        Run("nope").artifact("align")
    with pytest.raises(DsnetError, match="dsnet align --run r"):
        Run("r").artifact("align")


@pytest.mark.parametrize("name", ["", "a/b", "../x", ".hidden"])
def test_run_names_are_plain_folder_names(name):
    with pytest.raises(DsnetError, match="plain folder name"):
        Run(name)


def test_manifest_is_plain_json_with_provenance_apart(tmp_path):
    _, artifact = small(tmp_path / "align")
    manifest = json.loads((artifact.path / "manifest.json").read_text())
    assert {"command", "finished_utc", "wall_time_s", "machine", "versions"} <= set(
        manifest["provenance"]
    )


def flip(path, position=-1):
    content = bytearray(path.read_bytes())
    content[position] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize("rows", [3, 30_000])
def test_one_changed_byte_is_named_before_an_array_is_used(rows, tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    path = tmp_path / "r" / "s"
    arrays = {"x": np.ones((rows, 3))}
    artifact = write_artifact(path, "s", arrays, units={"x": "m"}, data="synthetic")
    for _ in range(2):
        artifact.array("x")
    flip(path / "x.npy")
    with pytest.raises(DsnetError, match=r"x\.npy with SHA-256"):
        read_artifact(path).array("x")


def test_one_changed_byte_of_a_file_is_named(tmp_path):
    writer = ArtifactWriter(tmp_path / "s", "s", data="synthetic")
    writer.file_path("weights.bin").write_bytes(bytes(100))
    artifact = writer.finish()
    assert artifact.file("weights.bin") == tmp_path / "s" / "weights.bin"
    flip(tmp_path / "s" / "weights.bin", 50)
    with pytest.raises(DsnetError, match=r"weights\.bin with SHA-256"):
        artifact.file("weights.bin")


def test_any_changed_byte_of_the_manifest_but_in_its_provenance_is_named(tmp_path):
    small(tmp_path / "a")
    path = tmp_path / "a" / "manifest.json"
    text = path.read_text()
    for position in range(0, text.index('"provenance"'), 7):
        if text[position].isspace():
            continue
        other = "7" if text[position] != "7" else "8"
        path.write_text(text[:position] + other + text[position + 1 :])
        with pytest.raises(DsnetError, match=r"manifest\.json"):
            read_artifact(tmp_path / "a")


def test_an_artifact_holds_what_was_declared_and_nothing_else(tmp_path):
    writer = ArtifactWriter(tmp_path / "s", "s", data="synthetic")
    writer.put("x", np.zeros(3), "m")
    weights = writer.file_path("deep/weights.bin")
    weights.write_bytes(b"w")
    for orphan in (".weights.bin.tmpOT0", "deep/.weights.bin.tmp", ".writing-1/body.npz"):
        (weights.parents[1] / orphan).parent.mkdir(exist_ok=True)
        (weights.parents[1] / orphan).write_bytes(b"half")
    artifact = writer.finish()
    assert list(artifact.manifest["files"]) == ["deep/weights.bin"]
    found = {p.relative_to(artifact.path).as_posix() for p in artifact.path.rglob("*")}
    assert found == {"manifest.json", "x.npy", "deep", "deep/weights.bin"}
    artifact.verify()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_no_stage_finishes_with_an_array_that_is_not_finite(value, tmp_path):
    write_artifact(tmp_path / "s", "s", {"x": [1.0]}, units={"x": "m"}, data="synthetic")
    writer = ArtifactWriter(tmp_path / "s", "s", data="synthetic")
    array = np.zeros((4, 2_000_000), np.float32)
    array[2, 1_234_567] = array[3, 0] = value
    writer.put("whole", np.array([2**62]), "1")
    writer.put("x", array, "m")
    with pytest.raises(DsnetError, match=r"stage 's' with NaN or infinity in x\[2\];"):
        writer.finish()
    # The one before is still there, and the next try begins anew.
    assert read_artifact(tmp_path / "s").array("x").shape == (1,)
    assert [path.name for path in tmp_path.iterdir()] == ["s"]


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


@pytest.mark.parametrize(
    "text", [b"[]", b"5", b"null", b"NaN", b"[" * 100_000, b"\xff", b" " * (17 << 20)]
)
def test_what_is_no_manifest_is_refused(folder: Path, text: bytes) -> None:
    (folder / "manifest.json").write_bytes(text)
    with pytest.raises(DsnetError, match=r"schema|is not JSON"):
        read_artifact(folder)


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


def test_a_value_that_a_stage_did_not_write_is_told(folder: Path) -> None:
    with pytest.raises(DsnetError, match="without 'sequences'"):
        sequences_of(read_artifact(folder))


def test_a_stage_that_was_made_from_itself_is_refused(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DSNET_RUNS", str(folder.parents[1]))
    forge(folder, lambda m: m["upstream"].update(align="0"))
    with pytest.raises(DsnetError, match="made from itself"):
        Run(folder.parent.name).check_chain(["align"])


def written(path: Path, at: float) -> Path:
    """A file of a turn, last changed then."""
    path.touch()
    os.utime(path, (at, at))
    return path


@pytest.mark.parametrize("text", ["", "1", "x y", "1 2 3", "\xff"])
def test_a_damaged_time_stops_no_work(tmp_path, text):
    first = ArtifactWriter(tmp_path / "toy", "toy", data="synthetic", fingerprint="a")
    (first.checkpoints / "turns").write_bytes(text.encode("latin-1"))
    second = ArtifactWriter(tmp_path / "toy", "toy", data="synthetic", fingerprint="a")
    assert 0 <= second.finish().manifest["provenance"]["wall_time_s"] < 10


def test_an_artifact_tells_the_time_of_all_its_turns(tmp_path):
    begun = time.time()
    first = ArtifactWriter(tmp_path / "toy", "toy", data="synthetic", fingerprint="a")
    (first.checkpoints / "one").touch()
    for file in first.checkpoints.iterdir():
        os.utime(file, (begun + 60, begun + 60))
    second = ArtifactWriter(tmp_path / "toy", "toy", data="synthetic", fingerprint="a")
    second.put("x", np.zeros(3), "m")
    made = second.finish().manifest["provenance"]
    assert 55 < made["wall_time_s"] < 90


def test_other_work_in_the_same_place_begins_anew(tmp_path):
    first = ArtifactWriter(tmp_path / "toy", "toy", data="synthetic", fingerprint="a")
    written(first.checkpoints / "one", time.time() + 60)
    other = ArtifactWriter(tmp_path / "toy", "toy", data="synthetic", fingerprint="b")
    other.put("x", np.zeros(3), "m")
    assert other.finish().manifest["provenance"]["wall_time_s"] < 30


def test_an_array_that_stays_as_it_was_written_is_not_read_again(tmp_path, monkeypatch):
    writer = ArtifactWriter(tmp_path / "s", "s", data="synthetic")
    writer.put("x", np.ones(3), "m")
    time.sleep(0.1)  # what was written just now is not trusted
    writer.finish()
    artifact = read_artifact(tmp_path / "s")
    monkeypatch.setattr("bridge.runs.artifact.sha256_of", lambda path: pytest.fail("read"))
    assert artifact.array("x").shape == (3,)
    before = (tmp_path / "s" / "x.npy").stat()
    monkeypatch.undo()
    flip(tmp_path / "s" / "x.npy")
    os.utime(tmp_path / "s" / "x.npy", ns=(before.st_atime_ns, before.st_mtime_ns))
    with pytest.raises(DsnetError, match=r"x\.npy with SHA-256"):
        artifact.array("x")
