"""A predictor of somebody's own, by the command line: one class in one file."""

from __future__ import annotations

import pytest

from bridge import DsnetError, cli
from bridge.runs import ArtifactWriter, read_artifact
from tests.forged.plugin import use_plugin
from tf_dsnet import stage_predict
from tf_dsnet.predictors import load_predictor
from tf_dsnet.stage_predict import PredictStageConfig

COMMAND = ["train", "--run", "tiny", "--epochs", "2", "--predictors", "mine", "dsnet_faithful"]


def test_it_is_trained_and_predicts(encoded_run, tmp_path, monkeypatch):
    use_plugin(tmp_path, monkeypatch)
    cli.main(COMMAND)
    made = read_artifact(encoded_run / "train")
    assert made.manifest["default"] == "mine"
    stage_predict.main(PredictStageConfig("tiny"))
    predicted = read_artifact(encoded_run / "predict")
    assert predicted.manifest["predictors"]["mine"] == "DSNet of mine"
    assert predicted.array("latents_mine").shape == (195, 100)
    monkeypatch.delenv("DSNET_PLUGINS")
    said = r"predictor mine; expected one of dsnet_standardised, dsnet_faithful\. .*DSNET_PLUGINS"
    with pytest.raises(DsnetError, match=said):
        stage_predict.main(PredictStageConfig("tiny"))


def test_without_the_module_nothing_is_made(encoded_run, capsys):
    with pytest.raises(SystemExit) as stopped:
        cli.main(COMMAND)
    printed = capsys.readouterr().err
    assert (stopped.value.code, printed.count("\n")) == (2, 1)
    assert "predictor mine; expected one of" in printed
    assert not list(encoded_run.glob("*train*"))


def test_a_file_that_names_a_module_does_not_import_it(runs, tmp_path, monkeypatch):
    name = use_plugin(tmp_path, monkeypatch, "raise SystemExit('imported')")
    monkeypatch.delenv("DSNET_PLUGINS")
    writer = ArtifactWriter(runs / "r" / "train", "train", data="synthetic")
    writer.record(default=name, predictors={name: {}})
    with pytest.raises(DsnetError, match=f"predictor {name}; expected one of"):
        load_predictor(writer.finish(), name, lambda: pytest.fail("no body"))
