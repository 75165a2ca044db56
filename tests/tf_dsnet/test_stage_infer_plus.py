"""Stage `infer` by `dsnet_plus`: offsets of the run's sequences and of unseen motions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body import load_body_model
from bridge.motion import sequences_of, subject_rows
from bridge.runs import read_artifact
from bridge.tissue.trained_plus import TrainedPlus
from bridge.verify.reference.oscillators import moving
from tests.forged.amass import save, smplh
from tests.forged.oscillating import people_of
from tests.tf_dsnet.plus import PEOPLE, TINY, forge_run
from tf_dsnet import stage_infer_plus, stage_train_plus
from tf_dsnet.oscillators.training import PlusTraining
from tf_dsnet.stage_infer_plus import InferPlusConfig


class MovingAlone(PlusTraining):
    def static_rounds(self) -> set[int]:
        return set()


def trained_run(
    runs: Path, monkeypatch: pytest.MonkeyPatch, *, static: bool = True, **aligned
) -> Path:
    run = forge_run(runs, monkeypatch, **aligned)
    training = PlusTraining if static else MovingAlone
    stage_train_plus.main(replace(TINY, rounds=1), training)
    return run


def test_evaluated_sequences_are_predicted_end_to_end(runs, monkeypatch):
    run = trained_run(runs, monkeypatch, static=False)
    stage_infer_plus.main(InferPlusConfig("tiny"))
    made, align = (read_artifact(run / name) for name in ("infer_plus", "align_robust"))
    made.verify()
    # The first training sequence of each person, and the one held out.
    names = ["50000_hips", "50001_hips", "50001_running"]
    placed = sequences_of(made)
    assert [s.name for s in placed] == names
    assert [(s.start, s.length) for s in placed] == [(0, 50), (50, 50), (100, 45)]
    assert set(made.manifest["arrays"]) == {"offsets_dsnet_plus", "theta", "betas"}
    assert made.manifest["arrays"]["offsets_dsnet_plus"]["unit"] == "m"
    assert made.manifest["predictors"] == {"dsnet_plus": stage_train_plus.LABEL}
    assert made.manifest["default"] == "dsnet_plus"
    np.testing.assert_array_equal(made.array("betas"), people_of(PEOPLE))
    body, model = (
        load_body_model("embedded:female"),
        TrainedPlus.load(read_artifact(run / "train_plus")),
    )
    source = {s.name: s for s in sequences_of(align)}
    for one, person in zip(placed, (0, 1, 1), strict=True):
        theta = align.array("theta")[source[one.name].frames]
        np.testing.assert_array_equal(made.array("theta")[one.frames], theta)
        expected = model.nodes.spread(moving(model, body, theta, people_of(PEOPLE)[person]))
        found = made.array("offsets_dsnet_plus")[one.frames]
        np.testing.assert_allclose(found, expected, atol=2e-6)


def test_the_static_part_is_in_the_whole_and_beside_it(runs, monkeypatch):
    run = trained_run(runs, monkeypatch, misfit_m=0.01)
    stage_infer_plus.main(InferPlusConfig("tiny"))
    made = read_artifact(run / "infer_plus")
    total, static = (made.array(f"{n}_dsnet_plus") for n in ("offsets", "static"))
    assert static.shape == total.shape == (145, 6890, 3)
    assert made.manifest["arrays"]["static_dsnet_plus"]["unit"] == "m"
    model = TrainedPlus.load(read_artifact(run / "train_plus"))
    body, theta = load_body_model("embedded:female"), made.array("theta")[:50]
    moved = model.nodes.spread(moving(model, body, theta, people_of(PEOPLE)[0]))
    np.testing.assert_allclose(total[:50] - static[:50], moved, atol=1e-6)
    assert np.abs(static).max() > 1e-3


def test_motions_of_known_and_new_people_follow(runs, monkeypatch, tmp_path):
    run = trained_run(runs, monkeypatch, misfit_m=0.01)
    save(tmp_path / "amass/50001/kicking_poses.npz", smplh(61, 120.0))
    save(tmp_path / "amass/50077/kicking_poses.npz", smplh(61, 120.0), betas=np.full(16, 0.5))
    stage_infer_plus.main(InferPlusConfig("tiny", amass=tmp_path / "amass"))
    made = read_artifact(run / "infer_plus")
    known, new = sequences_of(made)[-2:]
    assert (known.name, new.name) == ("50001_kicking", "50077_kicking")
    assert {(s.split, s.length, s.fps) for s in (known, new)} == {("test", 31, 60.0)}
    assert (known.start, new.start) == (145, 176)
    rows = subject_rows(sequences_of(made))
    np.testing.assert_array_equal(made.array("betas")[rows["50001"]], people_of(PEOPLE)[1])
    np.testing.assert_allclose(made.array("betas")[rows["50077"]], 0.5)
    model = TrainedPlus.load(read_artifact(run / "train_plus"))
    # A person whom nobody has scanned has no constant: what is left depends on the pose alone.
    static = made.array("static_dsnet_plus")
    constant = np.abs(model.static.constant_m[1]).mean()
    assert constant > 1e-3
    by_pose = np.abs(static[new.frames]).mean()
    assert by_pose < 0.2 * constant


def test_a_run_without_a_model_says_what_to_run(runs, monkeypatch):
    run = forge_run(runs, monkeypatch)
    with pytest.raises(DsnetError, match=r"without 'train_plus'") as caught:
        stage_infer_plus.main(InferPlusConfig("tiny"))
    assert "\n" not in str(caught.value)
    assert not (run / "infer_plus").exists()
