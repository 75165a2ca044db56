"""The stage `evaluate` on the forged run, against formulas written out here."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body import load_body_model, pose_vertices
from bridge.measure.stage_evaluate import EvaluateConfig, main
from bridge.motion import sequences_of, unpack_theta
from bridge.runs import Run


@pytest.fixture
def evaluated(forged):
    main(EvaluateConfig(run="forged"))
    return forged


def by_name(artifact):
    return {sequence.name: sequence for sequence in sequences_of(artifact)}


def test_r2_of_each_predictor(evaluated):
    result = evaluated.artifact("evaluate").manifest["per_sequence"][0]
    frames = slice(0, 9)
    aligned = evaluated.artifact("align").array("offsets")[frames].astype(float)
    predicted = evaluated.artifact("decode").array("offsets")[frames]
    errors = result["errors"]["aligned"]

    def r2(prediction):
        return 1 - ((prediction - aligned) ** 2).sum() / (aligned**2).sum()

    assert result["name"] == "50004_one_leg_jump"
    assert errors["smpl"]["r2"] == 0.0
    np.testing.assert_allclose(errors["dsnet"]["r2"], r2(predicted), rtol=1e-9)
    np.testing.assert_allclose(errors["mean_offset"]["r2"], r2(aligned.mean(axis=0)), rtol=1e-9)
    np.testing.assert_allclose(errors["autoencoder"]["r2"], 1 - 0.03**2, rtol=1e-4)


def test_mesh_error_is_that_of_the_posed_bodies(evaluated):
    predict, decode = evaluated.artifact("predict"), evaluated.artifact("decode")
    found = evaluated.artifact("evaluate").array("mesh_error_dsnet")
    body = load_body_model("embedded:female")
    for name, subject_row, source in (("50020_hips", 1, "align"), ("99001_kicking", 2, "truth")):
        frames = by_name(predict)[name].frames
        pose, trans = unpack_theta(predict.array("theta")[frames])
        shapes = np.repeat(predict.array("betas")[subject_row][None], len(pose), axis=0)
        reference = evaluated.artifact(source)
        offsets = reference.array("offsets")[by_name(reference)[name].frames]
        mesh = pose_vertices(body, shapes, pose, trans, offsets)
        predicted = pose_vertices(body, shapes, pose, trans, decode.array("offsets")[frames])
        expected = np.linalg.norm(predicted - mesh, axis=-1).mean(axis=1)
        np.testing.assert_allclose(found[by_name(decode)[name].frames], expected, rtol=1e-5)


def test_test_sequences_have_truth_but_no_autoencoder(evaluated):
    evaluate = evaluated.artifact("evaluate")
    result = evaluate.manifest["per_sequence"][-1]
    assert list(result["errors"]) == ["truth"]
    assert "autoencoder" not in result["errors"]["truth"]
    assert np.isnan(evaluate.array("mesh_error_autoencoder")[22:]).all()
    assert np.isfinite(evaluate.array("mesh_error_smpl")).all()


def test_alignment_is_judged_by_the_truth(evaluated):
    errors = evaluated.artifact("evaluate").manifest["alignment"]
    truth = evaluated.artifact("truth").array("offsets")[:22].astype(float)
    aligned = evaluated.artifact("align").array("offsets")
    expected = 1 - ((aligned - truth) ** 2).sum() / (truth**2).sum()
    np.testing.assert_allclose(errors["offsets"]["r2"], expected, rtol=1e-9)
    np.testing.assert_allclose(errors["betas_rms"], 0.1, rtol=1e-5)
    np.testing.assert_allclose(errors["trans_mm"]["mean"], 10 * np.sqrt(3), rtol=1e-3)
    assert 0.5 < errors["pose_deg"]["mean"] < 1.0
    assert errors["frame_error_mm"]["mean"] == pytest.approx(2.0)
    whole = errors["absorption"]["whole"]
    absorbed = ((truth - aligned) * truth).sum() / (truth**2).sum()
    np.testing.assert_allclose(whole["absorbed"], absorbed, rtol=1e-9)
    shape = load_body_model("embedded:female").shapedirs.sum(axis=-1) * 0.1
    by_shape = (shape * truth).sum() / (truth**2).sum()
    np.testing.assert_allclose(whole["absorbed_by_pose"], absorbed - by_shape, rtol=1e-5)


def test_licensed_runs_have_no_truth(forged_runs, tmp_path, monkeypatch):
    runs = tmp_path / "runs"
    shutil.copytree(forged_runs / "forged", runs / "bare", ignore=shutil.ignore_patterns("truth"))
    shutil.rmtree(runs / "bare" / "evaluate", ignore_errors=True)
    monkeypatch.setenv("DSNET_RUNS", str(runs))
    main(EvaluateConfig(run="bare"))
    manifest = Run("bare").artifact("evaluate").manifest
    assert set(manifest["alignment"]) == {"frame_error_mm"}
    assert set(manifest["splits"]) == {"validation", "train"}
    assert manifest["per_sequence"][-1]["errors"] == {}


def test_a_missing_stage_is_named(forged_runs, tmp_path, monkeypatch):
    runs = tmp_path / "runs"
    shutil.copytree(forged_runs / "forged" / "align", runs / "half" / "align")
    monkeypatch.setenv("DSNET_RUNS", str(runs))
    with pytest.raises(DsnetError, match="dsnet predict --run half"):
        main(EvaluateConfig(run="half"))
    assert not (runs / "half" / "evaluate").exists()
