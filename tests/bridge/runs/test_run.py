"""The chain: what was made from something that was made again since is refused, by name."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from benchmarks.speed.results import write_results
from bridge import DsnetError
from bridge.runs import Run
from dsnet.stages.stage_check import CheckConfig
from dsnet.stages.stage_check import main as check

CHAIN = {
    "align": (),
    "train-ae": ("align",),
    "encode": ("align", "train-ae"),
    "train": ("encode",),
    "infer": ("train", "encode"),
    "decode": ("infer", "encode", "train-ae"),
}


@dataclass(frozen=True)
class Config:
    run: str = "x"
    value: float = 0.0


def make(stage, value=0.0, inputs=None):
    run = Run("x")
    upstream = run.artifacts(*CHAIN[stage])
    seen = [float(artifact.array("x")[0]) for artifact in upstream.values()]

    def fill(writer):
        writer.put("x", np.array([sum(seen) + value]), "m")

    return run.build(
        stage, Config(value=value), fill, data="synthetic", upstream={**upstream, **(inputs or {})}
    )


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    for stage in CHAIN:
        make(stage, value=1.0)
    return Run("x")


REMADE = (
    "run 'x', whose stages encode, train, infer are older than 'train-ae'; expected one chain. "
    "Run `dsnet encode --run x`, `dsnet train --run x`, `dsnet infer --run x` again"
)


def test_what_is_older_than_its_source_is_refused_with_the_stages_to_run(run):
    make("train-ae", value=2.0)
    with pytest.raises(DsnetError) as caught:
        run.artifact("infer")
    assert str(caught.value).startswith(REMADE)
    with pytest.raises(DsnetError, match=r"whose stages encode, train are older than 'train-ae'"):
        run.artifact("train")
    with pytest.raises(DsnetError, match=r"stages encode, train, infer, decode are older"):
        run.artifacts("align", "infer", "decode")
    assert run.artifact("align")
    assert run.artifact("train-ae")


def test_making_them_again_in_order_mends_the_chain(run):
    make("train-ae", value=2.0)
    for stage in ("encode", "train", "infer"):
        make(stage, value=1.0)
    with pytest.raises(DsnetError, match=r"stage decode is older than 'infer', 'encode'"):
        run.artifact("decode")
    make("decode", value=1.0)
    assert run.artifact("decode").array("x")[0] > 0


def test_the_same_content_made_again_keeps_the_chain(run):
    before = run.artifact("decode").content_sha256
    make("train-ae", value=2.0)
    make("train-ae", value=1.0)
    assert run.artifact("decode").content_sha256 == before
    assert make("encode", value=1.0).content_sha256 == run.artifact("encode").content_sha256


def test_an_input_file_that_changed_is_named_while_it_is_there(run, tmp_path):
    body = tmp_path / "SMPL.npz"
    body.write_bytes(b"a" * 100_000)
    make("align", inputs={"smpl": body})
    assert run.artifact("align")
    body.write_bytes(b"b" * 100_000)
    with pytest.raises(DsnetError, match=r"stage align is older than '.*SMPL\.npz'.*dsnet align"):
        run.artifact("align")
    body.unlink()
    assert run.artifact("align")


def test_check_reads_every_byte_and_the_chain(run, capsys):
    check(CheckConfig("x"))
    assert capsys.readouterr().out.splitlines()[-1] == "run 'x': 6 stages, one chain"
    make("align", value=2.0)
    with pytest.raises(DsnetError, match=r"train-ae, encode, train, infer, decode are older"):
        check(CheckConfig("x"))


def test_check_does_not_trust_what_was_read_before(run, monkeypatch, capsys):
    digest = run.artifact("encode").digests["x.npy"]
    monkeypatch.setattr("bridge.runs.artifact.sha256_of", lambda path: digest)
    path = run.path / "encode" / "x.npy"
    content = path.read_bytes()
    path.write_bytes(content[:-1] + b"\x01")
    assert run.artifact("encode").array("x").shape == (1,)
    with pytest.raises(DsnetError, match=r"encode/x\.npy with SHA-256"):
        check(CheckConfig("x"))
    assert "encode       FAULT" in capsys.readouterr().out
    path.write_bytes(content)
    (run.path / "train" / "notes.txt").write_text("mine")
    with pytest.raises(DsnetError, match=r"train/notes\.txt, which is not part"):
        check(CheckConfig("x"))


def test_a_folder_that_has_lost_its_manifest_is_damage_until_it_is_made_again(run, capsys):
    (run.path / "train" / "manifest.json").unlink()
    lost = r"x/train, which has lost its manifest\.json.*`dsnet train --run x` again"
    for asked in (
        lambda: run.finished("train"),
        lambda: run.artifact("infer"),
        lambda: check(CheckConfig("x")),
    ):
        with pytest.raises(DsnetError, match=lost):
            asked()
    assert "train        FAULT" in capsys.readouterr().out
    assert run.artifact("encode")
    make("train", value=1.0)
    assert run.artifact("decode")
    (run.path / "train").rename(run.path / ".elsewhere")
    assert not run.finished("train")


def test_check_leaves_alone_what_is_no_stage(run, capsys):
    write_results("x", "speed", {"s": 1.0})
    (run.path / "notes").mkdir()
    check(CheckConfig("x"))
    said = capsys.readouterr().out.splitlines()
    for name in ("notes", "bench"):
        assert f"{name:<12} is not a stage of dsnet, left alone" in said
    assert said[-1] == "run 'x': 6 stages, one chain"
