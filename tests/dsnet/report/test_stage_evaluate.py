"""The stage `evaluate` on forged runs, against formulas written out here."""

from __future__ import annotations

import numpy as np
import pytest

from bridge.body import load_body_model, pose_vertices
from bridge.body.posing import shaped_vertices
from bridge.motion import MotionSequence, sequences_of, unpack_theta
from bridge.runs import Run
from dsnet.evaluation.evaluation import MESH_ERROR, evaluate_run, per_frame_m
from tests.forged.artifacts import put


@pytest.fixture
def evaluated(forged):
    evaluate_run(Run("forged"))
    return forged


def by_name(artifact):
    return {sequence.name: sequence for sequence in sequences_of(artifact)}


def mesh_of(artifact, name, row, offsets=None):
    """Posed meshes of a sequence, by the slow oracle."""
    pose, trans = unpack_theta(artifact.array("theta")[by_name(artifact)[name].frames])
    shapes = np.repeat(artifact.array("betas")[row][None], len(pose), axis=0)
    return pose_vertices(load_body_model("embedded:female"), shapes, pose, trans, offsets)


def offsets_of(artifact, name, array="offsets"):
    return artifact.array(array)[by_name(artifact)[name].frames].astype(float)


def posed(run, name, row, predictor):
    """(predicted, SMPL's, reference) meshes of a sequence."""
    predict, decode = run.artifact("infer"), run.artifact("decode")
    offsets = offsets_of(decode, name, f"offsets_{predictor}")
    reference = run.artifact("truth" if "kicking" in name else "align")
    real = mesh_of(reference, name, row, offsets_of(reference, name))
    return mesh_of(predict, name, row, offsets), mesh_of(predict, name, row), real


@pytest.mark.parametrize(
    ("name", "row"), [("50004_one_leg_jump", 0), ("50004_kicking", 0), ("99001_kicking", 2)]
)
def test_errors_are_those_of_posed_meshes(evaluated, name, row):
    results = evaluated.artifact("evaluate").manifest["per_sequence"]
    errors = next(one for one in results if one["name"] == name)["errors"]
    errors = {key: one["mesh"] for key, one in errors.items() if "mesh" in one}
    predicted, plain, real = posed(evaluated, name, row, "dsnet_small")
    r2 = 1 - ((predicted - real) ** 2).sum() / ((plain - real) ** 2).sum()
    distance_mm = 1e3 * np.linalg.norm(predicted - real, axis=-1)
    plain_mm = 1e3 * np.linalg.norm(plain - real, axis=-1)
    assert errors["smpl"]["r2"] == 0.0
    np.testing.assert_allclose(errors["dsnet_small"]["r2"], r2, rtol=1e-6)
    np.testing.assert_allclose(errors["dsnet_small"]["mean_mm"], distance_mm.mean(), rtol=1e-6)
    np.testing.assert_allclose(errors["smpl"]["mean_mm"], plain_mm.mean(), rtol=1e-6)
    frames = per_frame_m(evaluated.artifact("evaluate"), MESH_ERROR, "dsnet_small", name)
    assert frames is not None
    np.testing.assert_allclose(1e3 * frames, distance_mm.mean(axis=1), rtol=1e-5)


def test_true_offsets_are_compared_at_rest(evaluated):
    name = "50004_one_leg_jump"
    errors = evaluated.artifact("evaluate").manifest["per_sequence"][0]["errors"]
    errors = {key: one["offsets"] for key, one in errors.items()}
    true = offsets_of(evaluated.artifact("truth"), name)
    rebuilt = offsets_of(evaluated.artifact("decode"), name, "offsets_autoencoder")

    def r2(prediction):
        return 1 - ((prediction - true) ** 2).sum() / (true**2).sum()

    np.testing.assert_allclose(errors["dsnet_other"]["r2"], 1 - 0.8**2, rtol=1e-5)
    np.testing.assert_allclose(errors["autoencoder"]["r2"], r2(rebuilt), rtol=1e-6)
    np.testing.assert_allclose(errors["sequence_mean"]["r2"], r2(true.mean(axis=0)), rtol=1e-6)
    # One training sequence of this person, so its mean is the person's.
    mean = offsets_of(evaluated.artifact("align"), "50004_hips").mean(axis=0)
    np.testing.assert_allclose(errors["person_mean"]["r2"], r2(mean), rtol=1e-6)


def test_a_new_person_has_the_mean_of_all_people(evaluated):
    align = evaluated.artifact("align")
    means = [
        offsets_of(align, name).mean(axis=0) for name in ("50004_hips", "50020_jiggle_on_toes")
    ]
    mean = np.repeat(np.mean(means, axis=0)[None], 8, axis=0)
    found = mesh_of(evaluated.artifact("infer"), "99001_kicking", 2, mean)
    _, plain, real = posed(evaluated, "99001_kicking", 2, "dsnet_small")
    errors = evaluated.artifact("evaluate").manifest["cells"]["new_person_unseen_motion"]
    expected = 1 - ((found - real) ** 2).sum() / ((plain - real) ** 2).sum()
    np.testing.assert_allclose(errors["person_mean"]["mesh"]["r2"], expected, rtol=1e-6)


def forge_resting_person(root, prediction_share):
    """A known person at rest whose fitted shape is wrong: the offset needed is known exactly."""
    body = load_body_model("embedded:female")
    train = MotionSequence("50004_hips", "50004", "hips", 0, 2, 60.0)
    test = MotionSequence("50004_kicking", "50004", "kicking", 2, 3, 60.0, "test")
    true_betas, fitted_betas = np.zeros((1, 10), np.float32), np.full((1, 10), 0.5, np.float32)
    theta = np.zeros((5, 69), np.float32)
    tissue_m = np.full((5, 6890, 3), 2e-3, np.float32)
    shapes_m = [shaped_vertices(body, betas)[0] for betas in (true_betas, fitted_betas)]
    needed_m = tissue_m + shapes_m[0] - shapes_m[1]
    predictors = {"predictors": {"any": "Any"}, "default": "any"}
    stages = {
        "truth": {"theta": theta, "betas": true_betas, "offsets": tissue_m},
        "align": {
            "theta": theta[:2],
            "betas": fitted_betas,
            "offsets": needed_m[:2].astype(np.float32),
            "frame_error": np.zeros(2, np.float32),
        },
        "infer": {"theta": theta, "betas": fitted_betas},
        "decode": {
            "offsets_any": (prediction_share * needed_m).astype(np.float32),
            "offsets_autoencoder": 0 * tissue_m,
        },
    }
    for stage, arrays in stages.items():
        sequences = [train] if stage == "align" else [train, test]
        put(root / stage, arrays, sequences, config={}, **(predictors if stage == "decode" else {}))
    corpus = root / "corpus"
    corpus.mkdir()
    body.save_smpl_npz(corpus / "SMPL_FEMALE.npz")
    return 1e3 * np.linalg.norm(needed_m, axis=-1).mean()


@pytest.mark.parametrize(("share", "r2"), [(1.0, 1.0), (0.5, 0.75), (0.0, 0.0), (2.0, 0.0)])
def test_a_known_person_is_judged_with_the_shape_that_was_given(tmp_path, monkeypatch, share, r2):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    monkeypatch.setattr(
        "dsnet.evaluation.evaluation.body_model_path", lambda run: "embedded:female"
    )
    needed_mm = forge_resting_person(tmp_path / "rest", share)
    evaluate_run(Run("rest"))
    unseen = Run("rest").artifact("evaluate").manifest["cells"]["known_person_unseen_motion"]
    unseen = {key: one["mesh"] for key, one in unseen.items() if "mesh" in one}
    np.testing.assert_allclose(unseen["any"]["r2"], r2, atol=1e-5)
    np.testing.assert_allclose(unseen["any"]["mean_mm"], abs(1 - share) * needed_mm, atol=1e-3)
    np.testing.assert_allclose(unseen["smpl"]["mean_mm"], needed_mm, rtol=1e-5)
    # What a person's body needs at rest is the same in training and in the unseen motion.
    np.testing.assert_allclose(unseen["person_mean"]["r2"], 1.0, atol=1e-5)


def test_cells_are_pooled_with_their_spread(evaluated):
    manifest = evaluated.artifact("evaluate").manifest
    tests = [one for one in manifest["per_sequence"] if one["split"] == "test"]
    assert [one["person"] for one in tests] == ["known", "new"]
    cells = manifest["cells"]
    assert set(cells) == {"validation", "train", "test", *(one["cell"] for one in tests)}
    for cell, one in zip(
        ("known_person_unseen_motion", "new_person_unseen_motion"), tests, strict=True
    ):
        assert one["cell"] == cell
        pooled = cells[cell]["dsnet_small"]
        assert pooled["mesh"]["r2_se"] is None
        for measure, alone in one["errors"]["dsnet_small"].items():
            assert {key: pooled[measure][key] for key in alone} == alone
    # Leaving out either of two sequences gives the other's own R2.
    for metric in ("mesh", "offsets", "velocity"):
        alone = [one["errors"]["dsnet_small"][metric]["r2"] for one in tests]
        expected = abs(alone[0] - alone[1]) / 2
        pooled = cells["test"]["dsnet_small"][metric]
        np.testing.assert_allclose(pooled["r2_se"], expected, rtol=1e-9)


def test_what_is_not_compared_has_no_numbers(evaluated):
    evaluate = evaluated.artifact("evaluate")
    result = evaluate.manifest["per_sequence"][-1]
    assert "autoencoder" not in result["errors"]
    assert set(result["errors"]["smpl"]) == {"mesh", "offsets"}
    moving = {"mesh", "offsets", "velocity", "spectrum"}
    assert set(result["errors"]["dsnet_small"]) == moving
    assert per_frame_m(evaluate, MESH_ERROR, "autoencoder", "99001_kicking") is None
    assert evaluate.array("mesh_error_autoencoder").shape == (22,)
    assert evaluate.array("mesh_error_smpl").shape == (34,)
    for name in evaluate.manifest["arrays"]:
        assert np.isfinite(evaluate.array(name)).all()


def test_predictors_are_decodes_then_what_learns_nothing(evaluated):
    manifest = evaluated.artifact("evaluate").manifest
    own = ["dsnet_small", "dsnet_other", "autoencoder", "person_mean", "sequence_mean", "smpl"]
    assert list(manifest["predictors"]) == own
    assert manifest["predictors"]["dsnet_other"] == "DSNet, other"
    assert manifest["default"] == "dsnet_small"


def test_alignment_is_judged_by_the_truth(evaluated):
    errors = evaluated.artifact("evaluate").manifest["alignments"]["align"]
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


def test_licensed_runs_have_no_truth(copied):
    bare = copied("bare", "truth")
    evaluate_run(bare)
    manifest = bare.artifact("evaluate").manifest
    assert set(manifest["alignments"]["align"]) == {"frame_error_mm"}
    assert set(manifest["cells"]) == {"validation", "train"}
    assert manifest["per_sequence"][-1]["errors"] == {}
