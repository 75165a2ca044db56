"""A predictor of somebody's own, by the command line: one class in one file."""

from __future__ import annotations

import pytest

from bridge import cli
from bridge.runs import read_artifact
from tests.forged.plugin import use_plugin
from tf_dsnet import stage_predict
from tf_dsnet.stage_predict import PredictStageConfig

COMMAND = ["train", "--run", "tiny", "--epochs", "2", "--predictors", "mine", "dsnet_faithful"]


def refused(capsys, call) -> str:
    with pytest.raises(SystemExit) as stopped:
        call()
    printed = capsys.readouterr().err
    assert (stopped.value.code, printed.count("\n")) == (2, 1)
    return printed


def test_it_is_trained_and_predicts(encoded_run, tmp_path, monkeypatch, capsys):
    use_plugin(tmp_path, monkeypatch)
    cli.main(COMMAND)
    made = read_artifact(encoded_run / "train")
    assert made.manifest["default"] == "mine"
    stage_predict.main(PredictStageConfig("tiny"))
    predicted = read_artifact(encoded_run / "predict")
    assert predicted.manifest["predictors"]["mine"] == "DSNet of mine"
    assert predicted.array("latents_mine").shape == (195, 100)
    monkeypatch.delenv("DSNET_PLUGINS")
    said = refused(capsys, lambda: cli.main(["predict", "--run", "tiny", "--predictor", "mine"]))
    assert "predictor mine; expected one of dsnet_standardised, dsnet_faithful" in said
    assert "in DSNET_PLUGINS the module that registers mine" in said


def test_without_the_module_nothing_is_made(encoded_run, capsys):
    assert "predictor mine; expected one of" in refused(capsys, lambda: cli.main(COMMAND))
    assert not list(encoded_run.glob("*train*"))


def test_a_file_that_names_a_module_does_not_import_it(encoded_run, tmp_path, monkeypatch, capsys):
    name = use_plugin(tmp_path, monkeypatch, "raise SystemExit('imported')")
    monkeypatch.delenv("DSNET_PLUGINS")
    cli.main([*COMMAND[:-2], "dsnet_faithful"])
    manifest = encoded_run / "train" / "manifest.json"
    text = manifest.read_text().replace("dsnet_faithful", name)
    manifest.write_text(text)
    weights = encoded_run / "train" / "dsnet_faithful.safetensors"
    weights.rename(weights.with_name(f"{name}.safetensors"))
    said = refused(capsys, lambda: cli.main(["predict", "--run", "tiny"]))
    assert "imported" not in said
