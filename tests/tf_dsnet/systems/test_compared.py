"""Networks that are there to be compared with: from training to predictions, and the search."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import plugin
from benchmarks.systems import dyna_like
from benchmarks.systems.dsnet_variants import VARIANTS
from benchmarks.systems.loads import loads_on_skin
from benchmarks.systems.rate_search import RATES, RateSearch
from bridge import DsnetError
from bridge.body import load_body_model
from bridge.exchange.dsnet import DMPL, LATENTS_OF, dsnets_of, join_inputs, load_trained_dsnet
from bridge.runs import Artifact, read_artifact
from dsnet.stages import stage_infer, stage_train
from dsnet.stages.stage_infer import InferConfig
from dsnet.stages.stage_train import TrainConfig
from tests.tf_dsnet.trained import train_in
from tf_dsnet import train_networks
from tf_dsnet.predictors import load_predictor, registered_predictors

SYSTEMS = plugin.predictors()
COMPARED = tuple(SYSTEMS)
TINY = TrainConfig(
    run="tiny", epochs=20, frames=32, validate_every=4, checkpoint_every=3, predictors=COMPARED
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
    """A run in which all were trained, once: building the graphs takes half a minute."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(train_networks, "body_model_path", lambda run: "embedded:female")
        patch.setattr(dyna_like, "RIDGES", dyna_like.RIDGES[-2:])
        return train_in(tmp_path_factory.mktemp("compared"), TINY)


@pytest.fixture
def trained(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Artifact:
    monkeypatch.setenv("DSNET_RUNS", str(folder.parent))
    return read_artifact(folder / "train")


@pytest.mark.slow
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


@pytest.mark.slow
def test_no_frame_knows_a_later_one_but_for_what_loads_need(trained):
    later = THETA.copy()
    later[20:] += 0.3
    for name in COMPARED:
        predict = load_predictor(trained, name, lambda: BODY)
        known = 20 - (name == "dsnet_loads")
        one, other = (predict(theta, BETAS) for theta in (THETA, later))
        np.testing.assert_allclose(one[:known], other[:known], rtol=1e-4, atol=1e-6, err_msg=name)
        assert np.abs(one[20:] - other[20:]).max() > 1e-6


@pytest.mark.slow
def test_the_variants_differ_in_what_they_say(trained):
    def predict(name: str, betas=BETAS, theta=THETA):
        return load_predictor(trained, name, lambda: BODY)(theta, betas)

    np.testing.assert_array_equal(predict("dsnet_no_betas"), predict("dsnet_no_betas", BETAS + 1))
    known = read_artifact(trained.path.parent / "encode").array("betas")
    one, other = (predict("dsnet_rbf", betas) for betas in known)
    assert np.abs(one - other).max() > 1e-6
    parameters = {name: trained.manifest["predictors"][name]["parameters"] for name in COMPARED}
    assert parameters["dsnet_pca"] == parameters["dsnet_searched"] == 65_140
    layer = 4 * 60 * (60 + 60 + 1) + 4 * 60
    assert parameters["dsnet_two_lstm"] == 65_140 + layer
    assert parameters["dsnet_three_lstm"] == 65_140 + 2 * layer
    assert parameters["dsnet_no_betas"] == 65_140 - 10 * 64


def test_what_stands_in_a_layers_place_has_its_parameters():
    built = {one.name: one.build(input_size=79) for one in VARIANTS if "rbf" not in one.name}
    assert built["dsnet_no_batch_norm"].count_params() == 65_140 - 4 * 60
    lstm, window = 4 * 60 * (128 + 60 + 1), 60 * (3 * 128 + 1)
    assert built["dsnet_two_frames"].count_params() == 65_140 - lstm + window
    told = np.random.default_rng(0).normal(size=(1, 9, 79)).astype(np.float32)
    other = told.copy()
    other[:, 3] += 1
    moved = np.abs(built["dsnet_two_frames"](told) - built["dsnet_two_frames"](other)).max(axis=2)
    assert np.flatnonzero(moved[0]).tolist() == [3, 4, 5]


def test_loads_are_none_where_the_body_stands_as_it_was_scanned():
    standing = join_inputs(np.zeros((5, 69)), BETAS)
    told = loads_on_skin(standing, lambda: BODY)
    assert told.shape == (5, 370)
    np.testing.assert_array_equal(told[:, :10], np.tile(BETAS, (5, 1)))
    np.testing.assert_allclose(told[:, 10:], 0, atol=1e-5)


def test_nothing_else_takes_them_for_dsnet(encoded_run):
    stage_train.main(replace(TINY, epochs=1, predictors=("dsnet_faithful", "dsnet_two_lstm")))
    made = read_artifact(encoded_run / "train")
    assert dsnets_of(made) == ["dsnet_faithful"]
    with pytest.raises(DsnetError, match=r"'dsnet_two_lstm', which is not DSNet; .*faithful"):
        load_trained_dsnet(made, "dsnet_two_lstm")


@pytest.mark.slow
def test_killed_training_goes_on_bit_identically(encoded_run, monkeypatch):
    names = ("dsnet_rbf", "dsnet_masked")
    config = replace(TINY, predictors=names)
    stage_train.main(config)
    whole = read_artifact(encoded_run / "train")
    expected = {name: whole.file(f"{name}.safetensors").read_bytes() for name in names}
    stage_train.main(replace(config, epochs=1))
    epoch = RateSearch.epoch

    def killed(self, number, *, validate):
        if number == 11:
            raise KeyboardInterrupt
        epoch(self, number, validate=validate)

    with monkeypatch.context() as patch:
        patch.setattr(RateSearch, "epoch", killed)
        with pytest.raises(KeyboardInterrupt):
            stage_train.main(config)
    stage_train.main(config)
    again = read_artifact(encoded_run / "train")
    assert {n: again.file(f"{n}.safetensors").read_bytes() for n in names} == expected


class _Curve:
    """Stands for a trainer: its validation loss after each epoch is known."""

    def __init__(self, losses: dict[float, list[float]]) -> None:
        self.losses, self.lr, self.model = losses, RATES[0], None
        self.optimizer, self._place = SimpleNamespace(), 0

    def state(self):
        return {"place": np.array([self._place])}

    def restore(self, state):
        self._place = int(state["place"][0])

    def epoch(self, number):
        self._place += 1
        return self.loss()

    def loss(self):
        return self.losses[self.lr][self._place - 1]


def searched(losses: dict[float, list[float]], epochs: int, tmp_path: Path) -> RateSearch:
    curve = _Curve(losses)
    search = RateSearch("it", curve, epochs, curve.loss, dict, tmp_path / "none")  # pyright: ignore[reportArgumentType]
    for number in range(epochs):
        search.epoch(number, validate=True)
    return search


def test_the_best_rate_goes_on_and_its_best_epoch_is_kept(tmp_path):
    slow, good, wild = RATES
    falling = [3.0, 2.0, 1.0, 0.5, 0.7, *[0.9] * 30]
    search = searched({slow: [9.0] * 40, good: falling, wild: [float("nan")] * 40}, 20, tmp_path)
    assert search.lr == good
    # Each rate had two epochs; the best went on with its third.
    assert search.losses[6:9] == [1.0, 0.5, 0.7]
    assert (search._kept.loss, int(search._kept.state["place"][0])) == (0.5, 4)
    assert len(search.validation_losses) == 20


def test_it_says_so_if_every_rate_diverges(tmp_path):
    search = searched({rate: [float("nan")] * 20 for rate in RATES}, 10, tmp_path)
    with pytest.raises(DsnetError, match="it without a finite validation loss"):
        search.arrays()


def test_each_code_has_its_latents(encoded_run):
    encoded = read_artifact(encoded_run / "encode")
    assert {entry.code for entry in registered_predictors().values()} == set(LATENTS_OF)
    assert all(array in encoded.manifest["arrays"] for array in LATENTS_OF.values())
