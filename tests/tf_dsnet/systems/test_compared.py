"""Systems that are there to be compared with: from training to predictions, and no leaks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks import plugin
from benchmarks.systems import dyna_like, softsmpl_like
from benchmarks.systems.rate_search import RATES
from bridge.body import load_body_model
from bridge.exchange.dsnet import DMPL
from bridge.runs import Artifact, read_artifact
from dsnet.stages import stage_infer
from dsnet.stages.stage_infer import InferConfig
from dsnet.stages.stage_train import TrainConfig
from tests.tf_dsnet.trained import train_in
from tf_dsnet import train_networks
from tf_dsnet.predictors import load_predictor

SYSTEMS = plugin.predictors()
COMPARED = ("dsnet_differences", "dsnet_loads", "dyna_like", "casas_otaduy_like", "softsmpl_like")
"""One of each kind: building all of them takes minutes."""
TINY = TrainConfig(
    run="tiny", epochs=4, frames=32, validate_every=4, checkpoint_every=3, predictors=COMPARED
)
RNG = np.random.default_rng(8)
THETA, BETAS = np.cumsum(RNG.normal(0, 0.05, (30, 69)), axis=0), RNG.normal(size=10)
BODY = load_body_model("embedded:female")


@pytest.fixture(autouse=True)
def body(monkeypatch):
    """The forged run has no corpus."""
    for stage in (train_networks, stage_infer):
        monkeypatch.setattr(stage, "body_model_path", lambda run: "embedded:female")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run in which they were trained, once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(train_networks, "body_model_path", lambda run: "embedded:female")
        patch.setenv("DSNET_PLUGINS", plugin.__name__)
        patch.setattr(dyna_like, "RIDGES", dyna_like.RIDGES[-1:])
        learn = softsmpl_like.learn_pose_code
        patch.setattr(softsmpl_like, "learn_pose_code", lambda x, b, _: learn(x, b, 20))
        return train_in(tmp_path_factory.mktemp("compared"), TINY)


@pytest.fixture
def trained(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Artifact:
    monkeypatch.setenv("DSNET_PLUGINS", plugin.__name__)
    monkeypatch.setenv("DSNET_RUNS", str(folder.parent))
    return read_artifact(folder / "train")


def test_all_are_trained_saved_and_loaded_again(trained, folder):
    stage_infer.main(InferConfig("tiny"))
    made = read_artifact(folder / "infer")
    assert tuple(made.manifest["predictors"]) == COMPARED
    for name in COMPARED:
        entry, described = SYSTEMS[name], trained.manifest["predictors"][name]
        assert made.manifest["codes"][name] == described["code"] == entry.code
        assert described["lr"] in (0, *RATES) or name == "dsnet_differences"
        assert described["departures"]
        latents = made.array(f"latents_{name}")
        assert latents.shape == (195, 8 if entry.code == DMPL else 100)
        assert np.isfinite(latents).all()


def test_no_frame_knows_a_later_one_but_for_what_loads_need(trained):
    later = THETA.copy()
    later[20:] += 0.3
    for name in COMPARED:
        predict = load_predictor(trained, name, lambda: BODY)
        known = 20 - (name == "dsnet_loads")
        one, other = (predict(theta, BETAS) for theta in (THETA, later))
        np.testing.assert_allclose(one[:known], other[:known], rtol=1e-4, atol=1e-6, err_msg=name)
        assert np.abs(one[20:] - other[20:]).max() > 1e-6
