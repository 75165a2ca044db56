"""Which predictor moves a body: of a run, or of the package."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge import DsnetError
from bridge.body import load_body_model
from bridge.body.model_data import SMPL_JOINT_NAMES, SMPL_PARENTS
from bridge.motion import Motion, pack_theta, unpack_theta
from bridge.runs import Run, read_artifact
from bridge.tissue.trained_plus import NAME
from dsnet.cli import main
from dsnet.prediction.controls import Controls, controlled_body
from dsnet.prediction.load_model import PACKAGED, find_model, load_model, packaged_folder
from dsnet.prediction.moving_body import MovingBody, place_motion
from dsnet.prediction.prediction_files import predict_motion
from tests.forged import bvh
from tests.forged.amass import load_amass_motion
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
    said = "dsnet: dsnet_plus (soft flesh) of run 'r' predicts with ONNX Runtime: the run's best\n"
    first, last = capsys.readouterr().err.splitlines(keepends=True)
    assert first == said
    assert last.startswith("dsnet: wrote offsets.npy")
    assert set(made["upstream"]) == {"train_plus"}
    assert set(made["arrays"]) == {"offsets", "vertices"}


@pytest.mark.usefixtures("blank_strip", "both_pipelines")
def test_another_is_taken_when_asked(motion, tmp_path, capsys):
    made = predicted(tmp_path / "out", motion, "--predictor", "dsnet_faithful")
    assert (made["predictor"], made["why"]) == ("dsnet_faithful", "as requested")
    assert "dsnet_faithful" in capsys.readouterr().err
    assert set(made["upstream"]) == {"train", "train-ae"}
    assert set(made["arrays"]) == {"latents", "offsets", "vertices"}


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
    assert find_model(Run("r"), None).name == "dsnet_standardised"


def test_the_networks_are_not_offered_by_a_run_without(plus_run):
    with pytest.raises(DsnetError, match=r"one of dsnet_plus\..*`dsnet train --run r`"):
        find_model(plus_run, "dsnet_faithful")
    assert find_model(plus_run, None).name == NAME
    assert find_model(plus_run, NAME).why == "as requested"


def test_a_run_without_any_says_what_trains_one(aligned_run):
    with pytest.raises(DsnetError, match=r"without a trained predictor.*dsnet train --run r"):
        find_model(aligned_run, None)


def test_a_damaged_model_is_one_line(plus_run, motion, tmp_path):
    (plus_run.path / "train_plus" / f"{NAME}.safetensors").write_bytes(b"nothing")
    with pytest.raises(DsnetError, match="SHA-256"):
        predict_motion(plus_run, motion, tmp_path / "out")
    assert not (tmp_path / "out").exists()


GENDERS = ("female", "male")


@pytest.mark.parametrize("gender", GENDERS)
def test_they_are_as_they_were_written_and_say_synthetic(gender):
    model = read_artifact(packaged_folder(gender), PACKAGED)
    model.verify()
    assert (model.origin, model.manifest["gender"]) == ("synthetic", gender)


def test_the_body_is_of_the_motions_gender():
    assert load_model(None, gender="male").body.name == "embedded:male"
    assert load_model(None, gender="neutral").body.name == "embedded:female"


def test_another_predictor_needs_a_run():
    with pytest.raises(DsnetError, match=r"'dsnet_faithful' without a run.*dsnet_plus.*--run demo"):
        find_model(None, "dsnet_faithful", "female")


def test_a_bvh_moves_her_as_the_motion_does_that_it_was_made_of(tmp_path):
    sample = load_amass_motion("sample:walking")
    pose, places_m = unpack_theta(sample.theta[:30])
    body = load_body_model("embedded:female")
    skeleton = bvh.Skeleton(SMPL_JOINT_NAMES, SMPL_PARENTS, body.J_regressor @ body.v_template)
    (tmp_path / "walk.bvh").write_text(bvh.text(skeleton, bvh.world_of(pose), places_m))
    character, motion = Controls().load(None, None, tmp_path / "walk.bvh")
    moved = [
        np.concatenate([posed.vertices_m for posed in MovingBody(character, one)])
        for one in (
            place_motion(motion, character.body),
            replace(motion, theta=pack_theta(pose, places_m)),
        )
    ]
    # Her root joint rests 12 micrometres off the origin, about which AMASS's axes are turned.
    np.testing.assert_allclose(moved[0], moved[1], atol=2e-5)


@pytest.fixture(scope="module")
def hops() -> Motion:
    """Half a second of standing, one of hops by 20 cm, half a second of standing."""
    time = np.arange(120) / 60 - 0.5
    theta = np.zeros((120, 69))
    theta[:, 67] = np.where(abs(time - 0.5) < 0.5, 0.2 * np.abs(np.sin(2 * np.pi * time)), 0.0)
    return Motion(theta, np.zeros(10), "female", 60.0, 60.0, source=None)  # type: ignore[arg-type]


@pytest.mark.parametrize("gender", GENDERS)
@pytest.mark.parametrize("first_beta", [-2.0, 0.0, 2.0])
def test_hops_shake_every_body_and_standing_stills_it(gender, first_beta, hops):
    betas = np.zeros(10)
    betas[0] = first_beta
    character = load_model(None, gender=gender)
    moving = MovingBody(character, place_motion(replace(hops, betas=betas), character.body))
    size_mm = 1e3 * np.concatenate(
        [np.linalg.norm(posed.offsets_m, axis=-1).mean(axis=1) for posed in moving]
    )
    assert size_mm[0] < 1e-3
    assert 0.5 < size_mm.max() < 50  # no jolt, and no blow-up
    assert size_mm[-1] < 0.5 * size_mm.max()


def test_the_flesh_of_the_sample_that_repeats_does_too():
    """Over the seam its steps change no more than within the lap, as they do without --loop."""
    character, motion = Controls().load(None, None, Path("sample:walk_cycle"))
    laps = [
        np.concatenate(
            [p.offsets_m for p in controlled_body(character, motion, Controls(loop=loop))]
        )
        for loop in (True, False)
    ]
    looped, alone = (over_the_seam(lap[:60]) for lap in laps)
    assert looped < 1 < alone


def over_the_seam(lap_m: NDArray) -> float:
    """Second difference of offsets (T, V, 3) at the seam, as a part of the largest elsewhere."""
    around = np.concatenate([lap_m, lap_m[:2]])
    changes_m = np.linalg.norm(np.diff(around, 2, axis=0), axis=-1).max(axis=1)
    return float(changes_m[-2:].max() / changes_m[:-2].max())
