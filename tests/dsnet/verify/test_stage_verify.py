"""`dsnet verify`: what it prints and writes, and how it ends."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest

from bridge.exchange.engine import load_tensors, save_tensors
from bridge.runs import read_artifact, write_artifact
from dsnet.verify import compare, stage_verify
from dsnet.verify.engines import GPUS, EngineResult
from dsnet.verify.single_checks import BOTH

CONFIG = stage_verify.VerifyConfig(run="r", trained=False, full_size=False)


@pytest.fixture
def verify(tmp_path, monkeypatch, run_reference, checks, capsys):
    """Run the stage on three quick checks without a framework: exit status and printed text."""
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    quick = ("dsnet-T1", "ae-batch", "ae-decoder", "dsnet-training")
    few = [check for check in checks if check.name in quick]
    monkeypatch.setattr(stage_verify, "random_checks", lambda seed, body: [*few])
    spoilt = {"engine": "", "value": 0.0}

    def ask(engine, request, out):
        if engine in GPUS:
            return EngineResult(out, missing="no GPU")
        answer = run_reference(engine, request, out)
        if engine == spoilt["engine"]:
            _shift(out / "ae-batch.float32.safetensors", spoilt["value"])
        return answer

    monkeypatch.setattr(
        stage_verify,
        "verify",
        lambda checks, folder: compare.verify(checks, folder, ask),
    )

    def run(config=CONFIG, engine="", value=0.0):
        spoilt.update(engine=engine, value=value)
        with pytest.raises(SystemExit) as stopped:
            stage_verify.main(config)
        return stopped.value.code, capsys.readouterr().out

    return run


def _shift(path, value):
    arrays = load_tensors(path)
    arrays["layer/encoder.conv_3"][1, 2, 3] += value
    save_tensors(path, arrays)


def test_agreement_exits_with_0_and_leaves_a_complete_artifact(verify, tmp_path):
    status, printed = verify()
    assert status == 0
    artifact = read_artifact(tmp_path / "r" / "verify", "verify")
    artifact.verify()
    parity = json.loads(artifact.file("parity.json").read_text())
    assert parity["passed"]
    assert parity["diagnosis"] == {}
    assert {row["engine"] for row in parity["rows"]} == {"torch", "keras", "onnx"}
    count, skipped = len(parity["rows"]), parity["skipped"]
    assert f"{count} of {count} rows hold, {len(skipped)} skipped: no GPU\n" in printed
    assert printed.count(" ok\n") == count
    assert printed.count("  skipped: no GPU\n") == len(skipped)
    assert {(one["engine"], one["dtype"]) for one in skipped} == {*product(GPUS, BOTH)}
    assert {*parity["engines"]} == {"numpy", "torch", "keras", "onnx"}
    assert set(parity["tolerances"].values()) == {1e-10, 1e-5, 1e-4, 3e-2, 1e-1}
    assert [path.name for path in (tmp_path / "r").iterdir()] == ["verify"]


@pytest.mark.parametrize("value", [1e-2, np.nan])
def test_a_difference_exits_with_1_and_names_the_layer(verify, tmp_path, value):
    status, printed = verify(engine="keras", value=value)
    assert status == 1
    assert "keras: layer encoder.conv_3" in printed
    parity = json.loads((tmp_path / "r" / "verify" / "parity.json").read_text())
    assert not parity["passed"]
    (failed,) = [row for row in parity["rows"] if not row["passed"]]
    assert (failed["tensor"], failed["index"]) == ("layer/encoder.conv_3", [1, 2, 3])


def test_equal_results_have_equal_digests_and_it_is_never_skipped(verify, tmp_path):
    digests = set()
    for _ in range(2):
        assert verify()[0] == 0
        digests.add(read_artifact(tmp_path / "r" / "verify").content_sha256)
    assert len(digests) == 1
    assert verify(engine="torch", value=1.0)[0] == 1


@pytest.mark.parametrize(
    ("trained", "compared"),
    [(False, {"align"}), (True, {"align", "encode", "train-ae", "train"})],
)
def test_what_was_compared_is_recorded(verify, tmp_path, monkeypatch, trained, compared):
    """A verification of networks that were trained again since is old, and can be seen to be."""
    given: dict[str, Any] = {"units": {}, "data": "synthetic"}
    given["config"] = {"smpl": "embedded:female"}
    stages = {
        stage: write_artifact(tmp_path / "r" / stage, stage, {}, **given)
        for stage in ("align", "encode", "train-ae", "train", "infer")
    }
    monkeypatch.setattr(stage_verify, "trained_checks", lambda run: [])
    verify(replace(CONFIG, trained=trained))
    upstream = read_artifact(tmp_path / "r" / "verify").manifest["upstream"]
    assert upstream == {stage: stages[stage].content_sha256 for stage in compared}


def test_an_interrupt_leaves_nothing(tmp_path, monkeypatch):
    def interrupted(checks, folder):
        folder.mkdir(parents=True)
        raise KeyboardInterrupt

    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    monkeypatch.setattr(stage_verify, "verify", interrupted)
    with pytest.raises(KeyboardInterrupt):
        stage_verify.main(CONFIG)
    assert not list((tmp_path / "r").iterdir())
