"""Artifacts: what is written is read back, nothing half-written or damaged is seen."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from dataclasses import dataclass

import numpy as np
import pytest

from bridge import DsnetError
from bridge.runs import ArtifactWriter, Run, read_artifact, write_artifact

UNITS = {"betas": "1", "offsets": "m"}


def small(path, seed=0):
    rng = np.random.default_rng(seed)
    arrays = {"betas": rng.normal(size=(0, 10)), "offsets": rng.normal(size=(3, 4, 3))}
    return arrays, write_artifact(path, "align", arrays, units=UNITS, data="synthetic", note="x")


def test_round_trip_maps_arrays_and_describes_them(tmp_path):
    arrays, _ = small(tmp_path / "align")
    artifact = read_artifact(tmp_path / "align", "align")
    for name, array in arrays.items():
        read = artifact.array(name)
        assert isinstance(read, np.memmap) or not read.size
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


def test_an_unfinished_artifact_cannot_be_read(tmp_path):
    writer = ArtifactWriter(tmp_path / "align", "align", data="synthetic")
    writer.put("betas", np.zeros((2, 10)), "1")
    with pytest.raises(DsnetError, match="manifest"):
        read_artifact(tmp_path / "align")


@pytest.mark.parametrize(
    ("break_it", "word"),
    [
        (lambda p: (p / "manifest.json").write_text("{"), "JSON"),
        (lambda p: (p / "manifest.json").write_text("{}"), "schema"),
        *(
            (lambda p, text=text: (p / "manifest.json").write_bytes(text), r"schema|is not JSON")
            for text in (b"[]", b"5", b"null", b"NaN", b"[" * 100_000, b"\xff", b" " * (17 << 20))
        ),
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


def flip(path, position=-1):
    content = bytearray(path.read_bytes())
    content[position] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize("rows", [3, 30_000])
def test_one_changed_byte_is_named_before_it_is_used(rows, tmp_path):
    writer = ArtifactWriter(tmp_path / "s", "s", data="synthetic")
    writer.put("x", np.ones((rows, 3)), "m")
    writer.file_path("weights.bin").write_bytes(bytes(100))
    artifact = writer.finish()
    assert artifact.array("x").shape == (rows, 3)
    assert artifact.file("weights.bin") == tmp_path / "s" / "weights.bin"
    flip(tmp_path / "s" / "x.npy")
    for used in (artifact.verify, lambda: read_artifact(tmp_path / "s").array("x")):
        with pytest.raises(DsnetError, match=r"x\.npy with SHA-256"):
            used()
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
    (first.checkpoints / "one").touch()
    later = time.time() + 60
    os.utime(first.checkpoints / "one", (later, later))
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
