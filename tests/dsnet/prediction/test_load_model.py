"""Which predictor moves a body: of a run, or of the package."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge import DsnetError
from bridge.motion import Motion
from bridge.runs import Run, read_artifact
from bridge.tissue.trained_plus import NAME
from dsnet.cli import main
from dsnet.prediction.controls import Controls, controlled_body
from dsnet.prediction.load_model import PACKAGED, find_model, load_model, packaged_folder
from dsnet.prediction.moving_body import MovingBody, place_motion
from dsnet.prediction.prediction_files import predict_motion
from tests.forged.plus import write_plus


@pytest.fixture
def both_pipelines(trained_run, flesh) -> Run:
    write_plus(trained_run, flesh)
    return trained_run


@pytest.mark.usefixtures("blank_strip", "both_pipelines")
def test_the_best_of_both_pipelines_predicts_and_says_so(motion, tmp_path, capsys):
    main(["predict", "--run", "r", "--motion", str(motion), "--out", str(tmp_path / "out")])
    made = read_artifact(tmp_path / "out", "prediction").manifest
    assert (made["predictor"], made["label"], made["why"]) == (NAME, "soft flesh", "the run's best")
    said = "dsnet: dsnet_plus (soft flesh) of run 'r' predicts with ONNX Runtime: the run's best\n"
    first, last = capsys.readouterr().err.splitlines(keepends=True)
    assert first == said
    assert last.startswith("dsnet: wrote offsets.npy")
    assert set(made["upstream"]) == {"train_plus"}
    assert set(made["arrays"]) == {"offsets", "vertices"}


@pytest.mark.usefixtures("trained_run")
@pytest.mark.parametrize("asked", ["dsnet_plus", "nonsense", "dsnet_differences"])
def test_one_that_the_run_lacks_is_one_line(motion, tmp_path, refusal, asked):
    options = ["--run", "r", "--motion", str(motion), "--out", str(tmp_path / "out")]
    printed = refusal("predict", *options, "--predictor", asked)
    assert f"'{asked}'" in printed
    assert "one of dsnet_standardised, dsnet_faithful." in printed
    assert "`dsnet train --run r`" in printed
    assert not (tmp_path / "out").exists()
    assert find_model(Run("r"), None).name == "dsnet_standardised"


def test_what_a_run_has_not_trained_is_not_offered(aligned_run, flesh):
    with pytest.raises(DsnetError, match=r"without a trained predictor.*dsnet train --run r"):
        find_model(aligned_run, None)
    write_plus(aligned_run, flesh)
    with pytest.raises(DsnetError, match=r"one of dsnet_plus\..*`dsnet train --run r`"):
        find_model(aligned_run, "dsnet_faithful")
    assert find_model(aligned_run, None).name == NAME
    assert find_model(aligned_run, NAME).why == "as requested"


def test_a_damaged_model_is_one_line(plus_run, motion, tmp_path):
    (plus_run.path / "train_plus" / f"{NAME}.safetensors").write_bytes(b"nothing")
    with pytest.raises(DsnetError, match="SHA-256"):
        predict_motion(plus_run, motion, tmp_path / "out")
    assert not (tmp_path / "out").exists()


both_genders = pytest.mark.parametrize("gender", ["female", "male"])


@both_genders
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


@pytest.fixture(scope="module")
def hops() -> Motion:
    """Half a second of standing, one of hops by 20 cm, half a second of standing."""
    time = np.arange(120) / 60 - 0.5
    theta = np.zeros((120, 69))
    theta[:, 67] = np.where(abs(time - 0.5) < 0.5, 0.2 * np.abs(np.sin(2 * np.pi * time)), 0.0)
    return Motion(theta, np.zeros(10), "female", 60.0, 60.0, source=None)  # type: ignore[arg-type]


@both_genders
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
