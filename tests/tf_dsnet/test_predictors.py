"""DSNet on whole clips, and a predictor of somebody's own."""

from __future__ import annotations

import numpy as np
import pytest

from bridge import DsnetError
from bridge.runs import ArtifactWriter, read_artifact
from dsnet import cli
from dsnet.stages import stage_infer
from dsnet.stages.stage_infer import InferConfig
from dsnet.stream.streaming_predictor import StreamingPredictor
from tests.forged.plugin import use_plugin
from tests.pages import python_blocks
from tf_dsnet.predictors import load_predictor

RNG = np.random.default_rng(6)
THETA, BETAS = RNG.normal(1, 1, (3, 60, 69)), RNG.normal(1, 1, (3, 10))


def steps(predictor: StreamingPredictor, theta: np.ndarray, betas: np.ndarray) -> np.ndarray:
    return np.stack([predictor.step(frame, betas) for frame in theta.swapaxes(0, 1)], axis=1)


COMMAND = ["train", "--run", "tiny", "--epochs", "2", "--predictors", "mine", "dsnet_faithful"]


def test_it_is_trained_and_predicts(encoded_run, tmp_path, monkeypatch):
    use_plugin(tmp_path, monkeypatch)
    cli.main(COMMAND)
    made = read_artifact(encoded_run / "train")
    assert made.manifest["default"] == "mine"
    stage_infer.main(InferConfig("tiny"))
    predicted = read_artifact(encoded_run / "infer")
    assert predicted.manifest["predictors"]["mine"] == "DSNet of mine"
    assert predicted.array("latents_mine").shape == (195, 100)
    monkeypatch.delenv("DSNET_PLUGINS")
    said = r"predictor mine; expected one of dsnet_standardised, dsnet_faithful, .*DSNET_PLUGINS"
    with pytest.raises(DsnetError, match=said):
        stage_infer.main(InferConfig("tiny"))


def test_the_network_that_contributing_shows_is_trained_and_stepped(
    encoded_run, tmp_path, monkeypatch
):
    (block,) = [block for block in python_blocks("CONTRIBUTING.md") if "GRU" in block]
    use_plugin(tmp_path, monkeypatch, block)
    cli.main(["train", "--run", "tiny", "--epochs", "2", "--predictors", "gru"])
    made = read_artifact(encoded_run / "train")
    whole = load_predictor(made, "gru", lambda: pytest.fail("no body"))(THETA[0], BETAS[0])
    monkeypatch.delenv("DSNET_PLUGINS")  # the manifest says which layers it has
    streamed = steps(StreamingPredictor("tiny", "gru"), THETA[:1], BETAS[:1])[0]
    np.testing.assert_allclose(streamed, whole, rtol=1e-5, atol=1e-5 * np.abs(whole).max())


def test_without_the_module_nothing_is_made(encoded_run, refusal):
    assert "predictor mine; expected one of" in refusal(*COMMAND)
    assert not list(encoded_run.glob("*train*"))


def test_a_file_that_names_a_module_does_not_import_it(runs, tmp_path, monkeypatch):
    name = use_plugin(tmp_path, monkeypatch, "raise SystemExit('imported')")
    monkeypatch.delenv("DSNET_PLUGINS")
    writer = ArtifactWriter(runs / "r" / "train", "train", data="synthetic")
    writer.record(default=name, predictors={name: {}})
    with pytest.raises(DsnetError, match=f"predictor {name}; expected one of"):
        load_predictor(writer.finish(), name, lambda: pytest.fail("no body"))
