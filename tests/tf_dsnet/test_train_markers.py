"""`dsnet train --markers`: folders of people, good and bad, and the model that comes of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.skin_markers.truth import Flesh, flesh_model, packaged, write_recording
from bridge import DsnetError
from bridge.motion import load_motion
from bridge.runs import Run
from bridge.runs.run import TRAIN_MARKERS
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.fitting import train as markers_train
from dsnet.fitting.train import FITTED, subjects_of, train_on_markers
from dsnet.prediction.controls import root_joint_m
from dsnet.prediction.load_model import load_model
from dsnet.prediction.models import PlusModel
from dsnet.stages import stage_train


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two women, a man, a motion without markers, and a damaged file."""
    out = tmp_path_factory.mktemp("people")
    for number, gender in enumerate(("female", "female", "male")):
        base = load_model(None, None, gender)
        model = flesh_model(base.body, packaged(gender), {"chest": Flesh(3.2, 0.25, 2.0)})
        betas = np.full(10, 0.1 * number)
        motion = load_motion(Path("sample:jumping_jacks"))
        motion = replace(motion, betas=betas).about_root_joint(root_joint_m(base.body, betas))
        theta = np.asarray(motion.theta[:150], np.float64)
        write_recording(out / f"take{number}.npz", PlusModel(model, base.body), base.body, betas,
                        theta, np.random.default_rng(number))  # fmt: skip
    stored = dict(np.load(out / "take0.npz"))
    np.savez(out / "bare.npz", **{k: v for k, v in stored.items() if "marker" not in k})
    np.savez(out / "unnamed.npz", **{**stored, "marker_labels": np.array(["*1"] * 27)})
    (out / "damaged.npz").write_bytes((out / "take0.npz").read_bytes()[:5000])
    return out


def test_people_are_told_apart_and_the_rest_is_left_out(folder: Path) -> None:
    gender, people, refused = subjects_of(folder, None)
    assert gender == "female"
    # The unnamed markers are beside the pose of the first woman: refused when they are read.
    assert [len(person.files) for person in people] == [2, 1]
    why = {Path(file).name: reason for file, reason in refused.items()}
    assert set(why) == {"bare.npz", "damaged.npz", "take2.npz"}
    assert why["bare.npz"] == "no markers"
    assert why["take2.npz"] == "of a male body"
    assert subjects_of(folder, "male")[0] == "male"


def test_a_run_learns_and_predicts(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    stage_train.main(stage_train.TrainConfig(run="skin", markers=folder))
    said = capsys.readouterr().err
    assert "2 people (female)" in said
    assert "unnamed.npz: markers without names" in said
    assert "| chest | 2 |" in said
    artifact = Run("skin").artifact(TRAIN_MARKERS)
    assert artifact.origin == "licensed"
    chest = artifact.manifest["regions"]["chest"]
    assert chest["told"]
    assert "take0" not in (artifact.path / "manifest.json").read_text()

    found = load_model(Run("skin"))
    assert (found.name, found.body_model) == (FITTED, "embedded:female")
    base = packaged("female")
    fitted = TrainedPlus.load(artifact)
    assert len(fitted.people_betas) == len(base.people_betas) + 2
    changed = np.abs(fitted.weights.base["omega"] - base.weights.base["omega"]).max(axis=1)
    assert changed.max() > 0.1
    far = np.flatnonzero(changed == 0)
    assert len(far) > 50
    assert found.model.reset(np.zeros((1, 10)), np.zeros((1, 69))).shape[0] == 1

    made = artifact.path.stat().st_mtime_ns
    train_on_markers(Run("skin"), folder)
    assert Run("skin").artifact(TRAIN_MARKERS).path.stat().st_mtime_ns == made


def test_a_person_who_was_fitted_is_not_fitted_again(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, people, _ = subjects_of(folder, None)
    base = load_model(None, None, "female")
    tools = base.body, packaged("female")
    fits = []

    def fit(*arguments: object) -> dict:
        fits.append(arguments)
        return {}

    monkeypatch.setattr(markers_train, "fit_subject", fit)
    first, again = (
        markers_train._fit_or_resume(tools, (people[1], tmp_path / "kept.json")) for _ in "12"
    )
    assert len(fits) == 1
    assert first == again


def test_a_folder_without_anybody_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DsnetError, match="no motion"):
        subjects_of(tmp_path, None)
    with pytest.raises(DsnetError, match="a folder of motions"):
        subjects_of(tmp_path / "none", None)


def test_markers_and_predictors_exclude_one_another(tmp_path: Path) -> None:
    config = stage_train.TrainConfig(run="r", markers=tmp_path, predictors=("dsnet_plus",))
    with pytest.raises(DsnetError, match="--predictors with --markers"):
        stage_train.main(config)
