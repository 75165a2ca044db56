"""Stage `train` from a finished `encode` to weights, and after it was killed."""

from __future__ import annotations

import math
import shutil
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body import load_body_model
from bridge.exchange import load_weights
from bridge.exchange.dsnet import load_trained_dsnet
from bridge.exchange.train_options import settings_of
from bridge.runs import Run, read_artifact, write_artifact
from dsnet.stages import stage_infer, stage_train
from dsnet.stages.stage_infer import InferConfig
from dsnet.stages.stage_train import TrainConfig
from tests.forged.plus import soft_flesh, write_plus
from tests.tf_dsnet.curves import read_curve
from tests.tf_dsnet.plus import TINY as PLUS_TINY
from tests.tf_dsnet.plus import forge_run, teach_nothing
from tests.tf_dsnet.trained import train_in
from tf_dsnet import predictors, train_networks, trainer
from tf_dsnet.framework import keras
from tf_dsnet.predictors import DsnetPredictor

TINY = TrainConfig(run="tiny", epochs=5, frames=32, validate_every=2, checkpoint_every=2)


BOTH = ("dsnet_standardised", "dsnet_faithful")


@pytest.fixture(scope="module")
def whole_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run `tiny` in which both were trained without an interruption."""
    return train_in(tmp_path_factory.mktemp("whole"), TINY)


@pytest.fixture
def trained_run(whole_run: Path, runs: Path) -> Path:
    """A copy of it."""
    return shutil.copytree(whole_run, runs / "tiny")


def test_stage_leaves_both_predictors(whole_run):
    artifact = read_artifact(whole_run / "train")
    artifact.verify()
    assert not (whole_run / "train_plus").exists()
    kinds = "safetensors", "keras"
    assert set(artifact.manifest["files"]) == {f"{n}.{kind}" for n in BOTH for kind in kinds}
    for name in BOTH:
        assert artifact.array(f"loss_{name}").shape == (5,)
        assert artifact.array(f"validation_loss_{name}").shape == (3,)
        assert artifact.manifest["provenance"][f"epoch_s_{name}"] > 0
        np.testing.assert_array_equal(artifact.array(f"validation_epochs_{name}"), [2, 4, 5])
    assert artifact.manifest["parameters"] == {"dsnet": 65_140, "dsnet_trainable": 65_020}
    assert artifact.manifest["default"] == "dsnet_standardised"
    faithful, standardised = (artifact.manifest["predictors"][name] for name in BOTH[::-1])
    assert (faithful["lr"], faithful["departures"]) == (1e-4, [])
    assert standardised["departures"][1] == "Adam's learning rate is 0.001 instead of 0.0001"
    assert artifact.origin == "synthetic"
    with pytest.raises(DsnetError, match="'other'"):
        load_trained_dsnet(artifact, "other")


def test_faithful_predictor_learns_the_latents_as_they_are(whole_run):
    artifact = read_artifact(whole_run / "train")
    trained = load_trained_dsnet(artifact, "dsnet_faithful")
    np.testing.assert_array_equal(trained.scaling.restore(np.ones(100)), 1)
    latents = read_artifact(whole_run / "encode").array("latents")
    first_frames = [latents[s : s + 32] for s in (0, 25, 95, 130, 150)]
    per_clip = np.mean([np.linalg.norm(f[:32], axis=1).sum() for f in first_frames])
    assert 0.5 * per_clip < artifact.array("loss_dsnet_faithful")[0] < 1.5 * per_clip


def test_killed_stage_resumes_bit_identically(whole_run, encoded_run, monkeypatch):
    whole = read_artifact(whole_run / "train")
    expected = {name: load_weights(whole.file(f"{name}.safetensors")) for name in BOTH}
    killed_after = 7
    begun: list[int] = []
    epoch, lock = trainer.Trainer.epoch, threading.Lock()

    def dying_epoch(self, number):
        with lock:  # predictors are trained side by side
            if len(begun) == killed_after:
                raise KeyboardInterrupt
            begun.append(number)
        return epoch(self, number)

    monkeypatch.setattr(trainer.Trainer, "epoch", dying_epoch)
    with pytest.raises(KeyboardInterrupt):
        stage_train.main(TINY)
    assert not (encoded_run / "train").exists()
    begun[:] = ()
    killed_after = None
    stage_train.main(TINY)
    assert begun == [2, 2, 3, 3, 4, 4]

    resumed = read_artifact(encoded_run / "train")
    assert resumed.content_sha256 == whole.content_sha256
    for name, weights in expected.items():
        again = load_weights(resumed.file(f"{name}.safetensors"))
        for key, array in weights.items():
            np.testing.assert_array_equal(again[key], array)


def test_a_predictor_whose_checkpoint_is_behind_catches_up(whole_run, encoded_run, monkeypatch):
    whole = read_artifact(whole_run / "train")
    saves = iter([trainer.DsnetTraining.save] * 3)  # killed when one is saved after 4 epochs

    def dying_save(self):
        next(saves, _interrupt)(self)

    def _interrupt(_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(trainer.DsnetTraining, "save", dying_save)
        with pytest.raises(KeyboardInterrupt):
            stage_train.main(TINY)
    ticks = threading.local()

    def tick() -> int:
        """A clock of each thread by which every epoch takes a second."""
        ticks.now = getattr(ticks, "now", 0) + 1
        return ticks.now

    monkeypatch.setattr(train_networks, "time", SimpleNamespace(perf_counter=tick))
    stage_train.main(TINY)
    resumed = read_artifact(encoded_run / "train")
    assert resumed.content_sha256 == whole.content_sha256
    # One predictor had one epoch left, the other three.
    assert [resumed.manifest["provenance"][f"epoch_s_{name}"] for name in BOTH] == [1.0, 1.0]


class Gru(DsnetPredictor):
    """A network of one's own, without names of layers."""

    units, dropout = 8, 0.0

    def __init__(self, name: str = "gru") -> None:
        super().__init__(name, "GRU", build=self._network)

    def _network(self, input_size: int) -> keras.Model:
        motion = keras.Input((None, input_size))
        recurrent = keras.layers.GRU(self.units, return_sequences=True, dropout=self.dropout)(
            motion
        )
        return keras.Model(motion, keras.layers.Dense(100)(recurrent))


@pytest.fixture
def with_gru(monkeypatch: pytest.MonkeyPatch) -> type[Gru]:
    """A registered predictor `gru` whose width a test may change."""
    entries = {**predictors.registered_predictors(), "gru": Gru()}
    monkeypatch.setattr(predictors, "registered_predictors", lambda: entries)
    for option in ("units", "dropout"):
        monkeypatch.setattr(Gru, option, getattr(Gru, option))
    return Gru


def weights_of(run: Path, name: str) -> bytes:
    return (run / "train" / f"{name}.safetensors").read_bytes()


def test_trained_networks_stay_beside_a_new_one(trained_run, with_gru, capsys):
    before = read_artifact(trained_run / "train")
    weights = {name: weights_of(trained_run, name) for name in BOTH}
    stage_train.main(replace(TINY, predictors=("gru",), epochs=3))
    assert ", ".join(BOTH) in capsys.readouterr().err
    after = read_artifact(trained_run / "train")
    after.verify()
    assert list(after.manifest["predictors"]) == [*BOTH, "gru"]
    assert after.manifest["default"] == "dsnet_standardised"
    assert after.manifest["parameters"] == before.manifest["parameters"]
    for name in BOTH:
        assert weights_of(trained_run, name) == weights[name]
        assert after.manifest["predictors"][name] == before.manifest["predictors"][name]
        np.testing.assert_array_equal(after.array(f"loss_{name}"), before.array(f"loss_{name}"))
        assert after.array(f"validation_epochs_{name}").tolist() == [2, 4, 5]
    assert after.array("validation_epochs_gru").tolist() == [2, 3]

    # Named with the settings that each has, or not at all: nothing is made.
    for names, epochs in (((), 5), (("gru",), 3), (("dsnet_faithful",), 5)):
        stage_train.main(replace(TINY, predictors=names, epochs=epochs))
        assert read_artifact(trained_run / "train").content_sha256 == after.content_sha256


def test_a_network_is_trained_again_when_settings_or_layers_change(trained_run, with_gru):
    both = replace(TINY, predictors=("gru",))
    stage_train.main(both)
    faithful, gru = (weights_of(trained_run, name) for name in ("dsnet_faithful", "gru"))
    for option, value in (("units", 9), ("dropout", 0.5)):
        setattr(with_gru, option, value)
        stage_train.main(both)
        before, gru = gru, weights_of(trained_run, "gru")
        assert gru != before
    assert weights_of(trained_run, "dsnet_faithful") == faithful
    stage_train.main(replace(TINY, predictors=("dsnet_faithful",), epochs=6))
    assert weights_of(trained_run, "dsnet_faithful") != faithful
    again = read_artifact(trained_run / "train")
    assert again.array("loss_dsnet_faithful").shape == (6,)
    assert again.array("loss_dsnet_standardised").shape == (5,)
    settings = again.manifest["config"]["predictors"]
    epochs = {name: one["epochs"] for name, one in settings.items()}
    assert epochs == {"dsnet_standardised": 5, "dsnet_faithful": 6, "gru": 5}


class Times(keras.layers.Layer):
    """Multiplies; Keras does not save what is in the set."""

    def __init__(self, by: object) -> None:
        super().__init__()
        self.by = by

    def call(self, values):
        return 2 * values


class TellsItsOptions(Times):
    def get_config(self):
        return {"by": self.by}


@pytest.mark.parametrize("layer", [Times, TellsItsOptions])
def test_a_network_that_keras_cannot_save_is_refused_or_goes_without_its_file(
    layer, trained_run, monkeypatch, capsys
):
    def build(input_size: int) -> keras.Model:
        motion = keras.Input((None, input_size))
        return keras.Model(motion, keras.layers.Dense(100)(layer({2})(motion)))

    own = DsnetPredictor("own", "Own", build=build)
    entries = {**predictors.registered_predictors(), "own": own}
    monkeypatch.setattr(predictors, "registered_predictors", lambda: entries)
    train = replace(TINY, predictors=("own",))
    before = read_artifact(trained_run / "train").content_sha256
    if layer is Times:
        with pytest.raises(DsnetError, match="own, a layer of which does not tell its options"):
            stage_train.main(train)
        assert read_artifact(trained_run / "train").content_sha256 == before
        return
    stage_train.main(train)
    assert "no own.keras, as Keras cannot save the network" in capsys.readouterr().err
    files = read_artifact(trained_run / "train").manifest["files"]
    assert "own.safetensors" in files
    assert "own.keras" not in files


def test_the_lstm_may_be_kerass_own(trained_run):
    stage_train.main(replace(TINY, lstm="stock", predictors=("dsnet_faithful",)))
    made = read_artifact(trained_run / "train")
    settings = made.manifest["config"]["predictors"]
    assert [settings[name].get("lstm") for name in BOTH] == [None, "stock"]
    stock = load_weights(made.file("dsnet_faithful.safetensors"))
    stage_train.main(replace(TINY, predictors=("dsnet_faithful",)))
    block = load_weights(read_artifact(trained_run / "train").file("dsnet_faithful.safetensors"))
    differences = {name: np.abs(stock[name] - array).max() for name, array in block.items()}
    assert 0 < max(differences.values()) <= 5e-5 * max(np.abs(a).max() for a in block.values())


def test_losses_for_tensorboard_change_nothing_else(whole_run, encoded_run):
    stage_train.main(replace(TINY, tensorboard=True))
    made = read_artifact(encoded_run / "train")
    assert made.content_sha256 == read_artifact(whole_run / "train").content_sha256
    for name in BOTH:
        curves = encoded_run / "tensorboard" / name
        assert read_curve(curves / "train") == dict(enumerate(made.array(f"loss_{name}")))
        epochs = made.array(f"validation_epochs_{name}") - 1
        validated = dict(zip(epochs, made.array(f"validation_loss_{name}"), strict=True))
        assert read_curve(curves / "validation") == validated


def test_who_names_all_networks_gives_their_order(trained_run):
    stage_train.main(replace(TINY, predictors=BOTH[::-1]))
    artifact = read_artifact(trained_run / "train")
    assert artifact.manifest["default"] == "dsnet_faithful"
    assert list(artifact.manifest["predictors"]) == [*BOTH[::-1]]


def test_networks_of_other_latents_do_not_stay(trained_run, with_gru, capsys):
    encoded = read_artifact(trained_run / "encode")
    latents = encoded.array("latents") * 2
    arrays = {name: encoded.array(name) for name in encoded.manifest["arrays"]}
    units = {name: one["unit"] for name, one in encoded.manifest["arrays"].items()}
    extra = {"sequences": encoded.manifest["sequences"]}
    write_artifact(encoded.path, "encode", {**arrays, "latents": latents}, units=units,
                   data="synthetic", **extra)  # fmt: skip
    stage_train.main(replace(TINY, predictors=("gru",), epochs=1))
    assert list(read_artifact(trained_run / "train").manifest["predictors"]) == ["gru"]
    assert ", ".join(sorted(BOTH)) in capsys.readouterr().err


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("dsnet_faithful",) * 2, "Pass --predictors dsnet_standardised dsnet_faithful"),
        (("dsnet_pluss",), "dsnet_faithful, .*dsnet_plus.*Did you mean 'dsnet_plus'"),
        (("dsnet_plus",), "without an alignment by the robust aligner"),
    ],
)
def test_senseless_predictors_are_refused(encoded_run, names, said):
    with pytest.raises(DsnetError, match=said):
        stage_train.main(replace(TINY, predictors=names))
    assert not list(encoded_run.glob("*train*"))


def test_all_that_the_run_can_train_is_trained_and_predicts(encoded_run, monkeypatch, capsys):
    forge_run(encoded_run.parent, monkeypatch)
    few = replace(TINY, epochs=1, rounds=1, plus=PLUS_TINY)
    stage_train.main(few)
    assert capsys.readouterr().err == ""
    made = [read_artifact(encoded_run / name).manifest for name in ("train", "train_plus")]
    assert [list(one["predictors"]) for one in made] == [list(BOTH), ["dsnet_plus"]]
    assert [settings_of(one)["seed"] for one in made] == [few.seed, few.seed]
    stage_infer.main(InferConfig("tiny"))
    predicted = [read_artifact(encoded_run / name) for name in ("infer", "infer_plus")]
    assert "latents_dsnet_faithful" in predicted[0].manifest["arrays"]
    assert "offsets_dsnet_plus" in predicted[1].manifest["arrays"]


def test_without_codes_the_oscillators_are_trained_alone(runs, monkeypatch, capsys):
    run = forge_run(runs, monkeypatch)
    teach_nothing(monkeypatch)
    stage_train.main(replace(TINY, rounds=1, plus=PLUS_TINY))
    said = capsys.readouterr().err
    assert said == "dsnet: left out: dsnet_standardised, dsnet_faithful, which needs 'encode'\n"
    assert not (run / "train").exists()
    stage_infer.main(InferConfig("tiny"))
    assert {path.name for path in run.glob("infer*")} == {"infer_plus"}


def test_what_the_papers_pipeline_has_begun_is_not_left_out(runs, monkeypatch):
    run = forge_run(runs, monkeypatch)
    write_artifact(run / "align", "align", {}, units={}, data="synthetic")
    with pytest.raises(DsnetError, match="dsnet encode"):
        stage_train.main(replace(TINY, rounds=1, plus=PLUS_TINY))


def test_half_a_training_does_not_predict(trained_run, monkeypatch):
    forge_run(trained_run.parent, monkeypatch)
    (trained_run / ".train_plus.partial").mkdir()
    with pytest.raises(DsnetError, match="dsnet train "):
        stage_infer.main(InferConfig("tiny"))
    assert not (trained_run / "infer").exists()


def test_damage_of_one_pipeline_is_told_before_the_other_predicts(trained_run, monkeypatch):
    forge_run(trained_run.parent, monkeypatch)
    write_plus(Run("tiny"), soft_flesh(load_body_model("embedded:female")))
    weights = trained_run / "train_plus" / "dsnet_plus.safetensors"
    weights.write_bytes(weights.read_bytes()[:-1] + b"x")
    with pytest.raises(DsnetError, match="dsnet_plus"):
        stage_infer.main(InferConfig("tiny"))
    assert not (trained_run / "infer").exists()


def test_without_a_robust_alignment_the_networks_are_trained_alone(trained_run, capsys):
    """It is told again where they are already."""
    stage_train.main(TINY)
    said = capsys.readouterr().err
    assert said.startswith("dsnet: left out: dsnet_plus, which needs an alignment by the robust")
    assert said.count("\n") == 1
    assert not (trained_run / "train_plus").exists()


def test_weights_that_are_not_finite_are_one_line_and_leave_nothing(encoded_run):
    with pytest.raises(DsnetError, match=r"weights .* of dsnet_faithful with NaN") as caught:
        stage_train.main(replace(TINY, lr_faithful=1e38))
    assert "lower learning rate" in str(caught.value)
    assert not list(encoded_run.glob("*train*"))


def test_a_loss_that_is_not_finite_names_its_epoch(encoded_run, monkeypatch):
    monkeypatch.setattr(trainer.Trainer, "epoch", lambda self, number: math.nan)
    with pytest.raises(DsnetError, match="with a loss of nan in epoch 1"):
        stage_train.main(TINY)
    assert not list(encoded_run.glob("*train*"))
