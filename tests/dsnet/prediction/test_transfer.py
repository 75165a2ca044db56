"""The packaged flesh on other bodies that are the embedded one in other clothes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.other_bodies import cut_finer, renumbered
from bridge.body import BodyModelData, load_body_model
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.prediction import transfer_cache
from dsnet.prediction.load_model import load_model
from dsnet.prediction.models import PlusModel, predict_whole
from dsnet.prediction.transfer import carried, flesh_vertices
from dsnet.prediction.transfer_cache import body_digest, cache_folder, carried_over
from tests.forged.amass import load_amass_motion
from tests.forged.other_bodies import open_in_pieces, with_other_shapes, with_pelvis_off

HOME = load_body_model("embedded:female")
THETA = load_amass_motion("sample:jumping_jacks").theta[:90]
BETAS = np.random.default_rng(1).uniform(-1.5, 1.5, 10)
V = HOME.vertex_count


@pytest.fixture(scope="module")
def model() -> TrainedPlus:
    opened = load_model(None).model
    assert isinstance(opened, PlusModel)
    return opened.trained


def offsets_of(
    model: TrainedPlus, body: BodyModelData, betas: NDArray = BETAS
) -> NDArray[np.float32]:
    return np.concatenate([*predict_whole(PlusModel(model, body), THETA, betas).offsets_m])


@pytest.fixture(scope="module")
def at_home_m(model: TrainedPlus) -> NDArray[np.float32]:
    found = offsets_of(model, HOME)
    assert np.abs(found).max() > 0.03  # there is something to compare
    return found


def r2(truth: NDArray, found: NDArray) -> float:
    return float(1 - ((truth - found) ** 2).sum() / (truth**2).sum())


def test_the_same_surface_in_another_order_moves_the_same(model, at_home_m):
    other, order = renumbered(HOME)
    found_m = offsets_of(carried(model, HOME, other), other)
    np.testing.assert_allclose(found_m, at_home_m[:, order], atol=1e-6)


@pytest.mark.parametrize("make", [with_pelvis_off, lambda body: body], ids=["pelvis off", "same"])
def test_neither_its_place_nor_itself_is_another_body(
    model, at_home_m, make: Callable[[BodyModelData], BodyModelData]
):
    other = make(HOME)
    np.testing.assert_allclose(offsets_of(carried(model, HOME, other), other), at_home_m, atol=1e-6)


def test_more_vertices_move_as_those_that_both_have(model, at_home_m):
    other = cut_finer(HOME)
    assert other.vertex_count == 10_475
    found_m = offsets_of(carried(model, HOME, other), other)
    assert r2(at_home_m, found_m[:, :V]) > 0.99
    assert np.abs(found_m[:, V:]).max() < 1.1 * np.abs(at_home_m).max()


@pytest.mark.slow
def test_the_same_person_by_other_numbers_moves_the_same(model, at_home_m):
    other, mix, mean = with_other_shapes(HOME)
    betas = (BETAS - mean) @ mix.T
    plus = carried(model, HOME, other)
    assert r2(at_home_m, offsets_of(plus, other, betas)) > 0.999
    assert plus.elsewhere is not None
    told = betas @ plus.elsewhere.to_betas + plus.elsewhere.shift
    np.testing.assert_allclose(told, BETAS, atol=0.02)


@pytest.mark.slow
def test_a_known_person_keeps_what_she_has_besides(model):
    """The kernel over betas means her too; else her residual would be lost."""
    other, mix, mean = with_other_shapes(HOME)
    who = model.people_betas[0].astype(np.float64)
    without = replace(model, weights=replace(model.weights, residual=0 * model.weights.residual))
    hers_m, plain_m = offsets_of(model, HOME, who), offsets_of(without, HOME, who)
    found_m = offsets_of(carried(model, HOME, other), other, (who - mean) @ mix.T)
    assert r2(hers_m, found_m) > 0.999 > r2(hers_m, plain_m)


def test_an_open_surface_moves_and_its_loose_pieces_do_not(model, at_home_m):
    other = open_in_pieces(HOME)
    skin = flesh_vertices(other)
    assert V - 200 < len(skin) < V == skin.max() + 1
    found_m = offsets_of(carried(model, HOME, other), other)
    assert not found_m[:, V:].any()
    both = skin[HOME.v_template[skin, 1] > HOME.v_template[:, 1].min() + 0.1]
    assert r2(at_home_m[:, both], found_m[:, both]) > 0.999


@pytest.mark.slow
def test_another_persons_body_has_flesh_of_its_own(model):
    """A man's: no node is lost, and he shakes about as much."""
    other = load_body_model("embedded:male")
    plus = carried(model, HOME, other)
    assert len(plus.nodes) == len(model.nodes)
    found_m = offsets_of(plus, other, np.zeros(10))
    assert 0.01 < np.abs(found_m).max() < 0.1
    own = load_model(None, gender="male").model
    assert r2(np.concatenate([*predict_whole(own, THETA, np.zeros(10)).offsets_m]), found_m) > 0.5


def test_what_was_carried_over_is_kept(model, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    other, _ = renumbered(HOME)
    asked: list[int] = []

    def home() -> BodyModelData:
        asked.append(1)
        return HOME

    first = carried_over(model, "it", home, other)
    (kept,) = cache_folder().iterdir()
    monkeypatch.setattr(transfer_cache, "carried", pytest.fail)
    started = time.process_time()
    again = carried_over(model, "it", home, other)
    assert time.process_time() - started < 0.3
    assert len(asked) == 1
    for name, array in first.arrays().items():
        np.testing.assert_array_equal(again.arrays()[name], array)
    monkeypatch.undo()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    kept.write_bytes(kept.read_bytes()[:-9])  # damaged: it is made again
    assert len(carried_over(model, "it", home, other).nodes) == len(first.nodes)
    assert len(asked) == 2


def test_its_own_body_by_any_name_needs_no_carrying(model):
    same = replace(HOME, name="a copy", posedirs=HOME.posedirs.copy())
    assert body_digest(same) == body_digest(HOME)
    assert carried_over(model, "it", lambda: HOME, same) is model


def test_a_cache_that_cannot_be_written_is_none(model, monkeypatch, tmp_path):
    (tmp_path / "dsnet").write_text("in the way")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    other = with_pelvis_off(HOME)
    assert carried_over(model, "it", lambda: HOME, other).elsewhere is not None
