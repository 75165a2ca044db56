"""Dyna-like on a law of its own kind: found, stable, stored, resumed, rolled on its own past."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.systems.autoregression import Autoregression, DrivenClip
from benchmarks.systems.dyna_like import (
    RIDGES,
    DynaLaw,
    DynaLike,
    body_mass_index,
    closed_loop_error,
    fit_law,
    standard_shape,
)
from benchmarks.systems.fitted_once import FittedOnce
from bridge import DsnetError
from bridge.exchange import load_weights, save_weights
from bridge.exchange.train_options import PredictorSettings
from bridge.paper import N_BETAS
from tests.forged.driven import forged_data, people
from tf_dsnet.predictors import TrainingData

SETTINGS = PredictorSettings(epochs=4)
ENTRY = DynaLike()
MODULE = "benchmarks.systems.dyna_like"


@pytest.fixture(scope="module")
def data(body) -> TrainingData:
    return forged_data(body, clips=18, frames=150)


@pytest.fixture(scope="module")
def trained(data, tmp_path_factory) -> FittedOnce:
    training = ENTRY.training(SETTINGS, data, tmp_path_factory.mktemp("dyna") / "c.safetensors")
    for number in range(SETTINGS.epochs):
        training.epoch(number, validate=number % 2 == 1)
    return training


def test_a_motion_that_was_left_out_is_rolled_to_its_latents(trained, data, body):
    """Far from what one-step errors promise: two hundred frames on predictions alone."""
    predict = ENTRY.load(trained.arrays(), lambda: body)
    (clip,) = data.validation
    found = predict(clip.inputs[:, N_BETAS:], clip.betas)
    assert (found.shape, found.dtype) == (clip.latents.shape, np.float32)
    missed = np.square(found - clip.latents).sum() / np.square(clip.latents).sum()
    assert missed < 0.01


def test_shape_matters_and_is_held_to_the_known_range(trained, data, body):
    predict = ENTRY.load(trained.arrays(), lambda: body)
    theta = data.validation[0].inputs[:, N_BETAS:]
    known = sorted(people(3), key=lambda betas: body_mass_index(body, betas))
    slim, stout = predict(theta, known[0]), predict(theta, known[-1])
    assert np.abs(slim - stout).max() > 0.1 * np.abs(stout).max()
    assert standard_shape(80.0, np.array([20.0, 22.0])) == 1.0
    assert standard_shape(10.0, np.array([20.0, 22.0])) == -1.0
    assert standard_shape(25.0, np.array([20.0])) == 0.0


def test_a_body_grown_all_over_weighs_more_for_its_height(body):
    grown = replace(body, shapedirs=np.repeat(np.asarray(body.v_template)[:, :, None], 10, axis=2))
    there, larger = (body_mass_index(grown, np.array([b] + [0.0] * 9)) for b in (0.0, 0.1))
    assert 15 < there < 35
    np.testing.assert_allclose(larger, 1.1 * there)


def test_every_known_person_and_those_between_have_decaying_modes(trained, body):
    law = DynaLaw.from_arrays("dyna_like", trained.arrays())
    known = [standard_shape(bmi, law.known_bmi) for bmi in law.known_bmi]
    for shape in [*known, *np.linspace(min(known), max(known), 7)]:
        assert law.law.spectral_radius(shape) < 1


def test_the_ridge_is_that_of_the_least_error_on_its_own_past(data, body, monkeypatch):
    """Not of the least one-step error, which the smallest ridge always has."""
    rng = np.random.default_rng(0)
    law = Autoregression(rng.normal(size=(2, 6, 2)) * 0.1)

    def clip(frames: int) -> DrivenClip:
        x = rng.normal(size=(frames, 1))
        return DrivenClip(x, law.roll(x, 0.5) + 0.3 * rng.normal(size=(frames, 2)), 0.5)

    train, validation = [clip(9)], [clip(400)]
    errors = {}

    def recorded(law, clips):
        errors[id(law)] = closed_loop_error(law, clips)
        return errors[id(law)]

    monkeypatch.setattr(f"{MODULE}.closed_loop_error", recorded)
    found, error = fit_law(train, validation)
    assert len(errors) == len(RIDGES)
    assert error == errors[id(found)] == min(errors.values()) < max(errors.values())


def test_what_grows_in_the_clips_decays_in_the_law():
    growing = Autoregression(np.zeros((2, 4, 1)))
    growing.weights[0, :, 0] = 2 * 1.02 * np.cos(0.3), -(1.02**2), 1.0, 0.0
    drivers = np.random.default_rng(1).normal(size=(3, 60, 1))
    clips = [DrivenClip(x, growing.roll(x, s), s) for x, s in zip(drivers, (-1, 0, 1), strict=True)]
    found, _ = fit_law(clips[:2], clips[2:])
    assert [found.spectral_radius(s) < 1 for s in (-1.0, -0.5, 0.0)] == [True] * 3
    assert found.spectral_radius(-0.5) > 0.9


def test_no_later_frame_and_no_target_is_looked_at(trained, data, body):
    predict = ENTRY.load(trained.arrays(), lambda: body)
    theta = np.array(data.validation[0].inputs[:, N_BETAS:])
    betas = people(3)[0]
    other = theta.copy()
    other[40:] = theta[40:][::-1]
    np.testing.assert_array_equal(predict(other, betas)[:40], predict(theta, betas)[:40])
    np.testing.assert_array_equal(predict(theta[:40], betas), predict(theta, betas)[:40])


def test_place_and_heading_do_not_matter(trained, data, body):
    predict = ENTRY.load(trained.arrays(), lambda: body)
    theta, betas = np.array(data.validation[0].inputs[:, N_BETAS:]), people(3)[1]
    there = theta + np.array([0.0] * 66 + [3.0, 0.0, -2.0])
    here = predict(theta, betas)
    np.testing.assert_allclose(predict(there, betas), here, atol=1e-4 * np.abs(here).max())


def test_one_epoch_fits_and_the_others_keep_it(trained, data):
    assert len(trained.losses) == SETTINGS.epochs
    assert len(set(trained.losses)) == 1
    assert len(trained.validation_losses) == 2
    assert trained.parameters() == {"dyna_like": 2 * 339 * 100}


def test_a_stored_law_predicts_the_same(trained, data, body, tmp_path):
    save_weights(tmp_path / "law.safetensors", trained.arrays())
    again = ENTRY.load(load_weights(tmp_path / "law.safetensors"), lambda: body)
    theta, betas = data.validation[0].inputs[:, N_BETAS:], people(3)[2]
    one, other = (
        predict(theta, betas) for predict in (ENTRY.load(trained.arrays(), lambda: body), again)
    )
    np.testing.assert_array_equal(one, other)


def test_a_killed_training_goes_on_to_the_same_bits(trained, data, tmp_path: Path, monkeypatch):
    checkpoint = tmp_path / "c.safetensors"
    monkeypatch.setattr(f"{MODULE}.fit_dyna", lambda *_: trained._fitted())
    first = ENTRY.training(SETTINGS, data, checkpoint)
    for number in range(2):
        first.epoch(number, validate=number % 2 == 1)
    first.save()
    monkeypatch.setattr(f"{MODULE}.fit_dyna", lambda *_: pytest.fail("fitted twice"))
    second = ENTRY.training(SETTINGS, data, checkpoint)
    assert second.losses == trained.losses[:2]
    for number in range(SETTINGS.epochs):
        second.epoch(number, validate=number % 2 == 1)
    assert (second.losses, second.validation_losses) == (trained.losses, trained.validation_losses)
    expected = trained.arrays()
    assert second.arrays().keys() == expected.keys()
    for name, array in second.arrays().items():
        np.testing.assert_array_equal(array, expected[name])


def test_only_the_frames_that_all_are_trained_on_are_fitted(data, tmp_path, monkeypatch):
    monkeypatch.setattr(f"{MODULE}.RIDGES", RIDGES[2:3])

    def law(clips: TrainingData) -> np.ndarray:
        short = replace(SETTINGS, frames=60)
        training = ENTRY.training(short, clips, tmp_path / "none.safetensors")
        training.epoch(0, validate=True)
        return training.arrays()["law"]

    cut = [replace(c, inputs=c.inputs[:60], latents=c.latents[:60]) for c in data.train]
    held = [replace(c, inputs=c.inputs[:60], latents=c.latents[:60]) for c in data.validation]
    np.testing.assert_array_equal(law(data), law(replace(data, train=cut, validation=held)))


def test_another_predictors_arrays_are_refused_in_one_line(body):
    with pytest.raises(DsnetError, match=r"dyna_like of arrays law \(0,\)") as caught:
        ENTRY.load({"fc_enc_1/kernel": np.zeros((79, 64))}, lambda: body)
    assert "\n" not in str(caught.value)


def test_nothing_fitted_is_refused(data, tmp_path):
    with pytest.raises(DsnetError, match="before its first epoch"):
        ENTRY.training(SETTINGS, data, tmp_path / "none.safetensors").arrays()


def test_it_says_what_is_ours():
    assert (ENTRY.code, ENTRY.label) == ("pca", "Dyna-like, linear autoregression")
    told = " ".join(ENTRY.departures(SETTINGS))
    for word in ("vertex offsets", "body mass index", "ridge", "mean offset"):
        assert word in told
