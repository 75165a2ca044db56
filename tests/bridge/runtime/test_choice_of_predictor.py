"""Which of a run's predictors predicts a motion, and what is said of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from bridge import DsnetError
from bridge.cli import main
from bridge.runs import Run, read_artifact
from bridge.runtime.load_model import find_model
from bridge.runtime.stage_predict import predict_motion
from bridge.tissue.trained_plus import NAME
from tests.forged.plus import write_plus


@pytest.fixture
def both_pipelines(trained_run, flesh) -> Run:
    write_plus(trained_run, flesh)
    return trained_run


def predicted(out: Path, motion: Path, *options: str) -> dict:
    main(["predict", "--run", "r", "--motion", str(motion), "--out", str(out), *options])
    return read_artifact(out, "prediction").manifest


@pytest.mark.usefixtures("blank_strip", "both_pipelines")
def test_the_best_of_both_pipelines_predicts_and_says_so(motion, tmp_path, capsys):
    made = predicted(tmp_path / "out", motion)
    assert (made["predictor"], made["label"], made["why"]) == (NAME, "soft flesh", "the run's best")
    said = "dsnet: dsnet_plus (soft flesh) of run 'r' predicts: the run's best\n"
    assert capsys.readouterr().err == said
    assert set(made["upstream"]) == {"train_plus"}
    assert set(made["arrays"]) == {"offsets", "vertices"}


@pytest.mark.usefixtures("blank_strip", "both_pipelines")
def test_another_is_taken_when_asked(motion, tmp_path, capsys):
    made = predicted(tmp_path / "out", motion, "--predictor", "dsnet_faithful")
    assert (made["predictor"], made["why"]) == ("dsnet_faithful", "as asked")
    assert "dsnet_faithful" in capsys.readouterr().err
    assert set(made["upstream"]) == {"train", "train-ae"}
    assert set(made["arrays"]) == {"latents", "offsets", "vertices"}


def test_a_run_of_one_pipeline_offers_that(trained_run):
    assert find_model(trained_run, None).name == "dsnet_standardised"


def test_a_run_of_the_other_pipeline_offers_that(plus_run):
    assert find_model(plus_run, None).name == NAME
    assert find_model(plus_run, NAME).why == "as asked"


@pytest.mark.usefixtures("trained_run")
@pytest.mark.parametrize("asked", ["dsnet_plus", "nonsense", "dsnet_differences"])
def test_one_that_the_run_lacks_is_one_line(motion, tmp_path, capsys, asked):
    with pytest.raises(SystemExit) as stopped:
        predicted(tmp_path / "out", motion, "--predictor", asked)
    printed = capsys.readouterr().err
    assert (stopped.value.code, printed.count("\n")) == (2, 1)
    assert f"'{asked}'" in printed
    assert "one of dsnet_standardised, dsnet_faithful." in printed
    assert "`dsnet train --run r`" in printed
    assert not (tmp_path / "out").exists()


def test_the_nearest_of_a_run_is_offered(trained_run):
    with pytest.raises(DsnetError, match=r"Did you mean 'dsnet_standardised'\? .*dsnet train"):
        find_model(trained_run, "dsnet_standardized")


def test_the_networks_are_not_offered_by_a_run_without(plus_run):
    with pytest.raises(DsnetError, match=r"one of dsnet_plus\..*`dsnet train --run r`"):
        find_model(plus_run, "dsnet_faithful")


def test_a_run_without_any_says_what_trains_one(aligned_run):
    with pytest.raises(DsnetError, match=r"without a trained predictor.*dsnet train --run r"):
        find_model(aligned_run, None)


def test_an_unknown_run_says_which_there_are(plus_run):
    with pytest.raises(DsnetError, match=r"unknown run 'nope' \(known: r\)"):
        find_model(Run("nope"), None)


def test_a_damaged_model_is_one_line(plus_run, motion, tmp_path):
    (plus_run.path / "train_plus" / f"{NAME}.safetensors").write_bytes(b"nothing")
    with pytest.raises(DsnetError, match="SHA-256"):
        predict_motion(plus_run, motion, tmp_path / "out")
    assert not (tmp_path / "out").exists()
