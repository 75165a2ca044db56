"""Both pipelines of a run in one evaluation, each measured with its own motions and alignment."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body import load_body_model, pose_vertices
from bridge.motion import MotionSequence, sequences_of, unpack_theta
from bridge.runs import Run, read_artifact
from dsnet.evaluation.evaluation import OFFSET_SIZE, evaluate_run, per_frame_m
from tests.forged.artifacts import put
from tests.forged.best_pipeline import PLUS, write_best_pipeline

SEQUENCES = [
    MotionSequence("50004_one_leg_jump", "50004", "one_leg_jump", 0, 8, 60.0, "validation"),
    MotionSequence("50004_hips", "50004", "hips", 8, 8, 60.0),
    MotionSequence("50004_hips_take2", "50004", "hips_take2", 16, 9, 60.0, "test"),
    MotionSequence("50004_kicking", "50004", "kicking", 25, 9, 60.0, "test"),
    MotionSequence("99001_hips", "99001", "hips", 34, 9, 60.0, "test"),
    MotionSequence("99001_stopping", "99001", "stopping", 43, 90, 60.0, "test"),
]
ALIGNED, FRAMES = SEQUENCES[:2], 133
FOUR = [
    f"{person}_person_{motion}_motion"
    for person in ("known", "new")
    for motion in ("known", "unseen")
]
STOP = 43 + 20
SMPL = {"config": {"smpl": None}}
MODEL_PATH = "dsnet.evaluation.evaluation.body_model_path"


def forge(run, *, captured=False, paper=True):
    """A run whose last sequence walks for 20 frames and then stands; flesh swings at 5 Hz."""
    rng = np.random.default_rng(0)
    body = load_body_model("embedded:female")
    theta = np.zeros((FRAMES, 69), np.float32)
    theta[:, :66] = 0.05 * rng.normal(size=66)
    theta[43:STOP, 68] = np.arange(-20, 0) / 60.0  # a metre a second, forward
    times = (np.arange(FRAMES) - STOP) / 60
    swing = np.exp(-4 * np.clip(times, 0, None)) * np.cos(2 * np.pi * 5 * times)
    shape = 2e-3 * np.cos(4 * body.v_template[:, [1, 2, 0]])
    offsets = (swing[:, None, None] * shape).astype(np.float32)
    betas = rng.normal(size=(2, 10)).astype(np.float32)
    static = {"static": np.broadcast_to(np.float32(3 * shape[::-1]), offsets.shape)}
    arrays = {"theta": theta, "betas": betas, "offsets": offsets}
    arrays |= {name: np.array(value) for name, value in static.items()} if captured else {}
    put(run / "truth", arrays, SEQUENCES, **SMPL, **({"form": "captured"} if captured else {}))
    given = {"theta": theta + np.float32(0.003), "betas": betas.copy()}
    given["betas"][0] += np.float32(0.2)
    aligned = {"theta": given["theta"][:16], "betas": given["betas"][:1], "offsets": offsets[:16]}
    put(run / "align", aligned | {"frame_error": np.zeros(16, np.float32)}, ALIGNED, **SMPL)
    if paper:
        put(run / "infer", given, SEQUENCES, **SMPL)
        labels = {"predictors": {"dsnet": "DSNet"}, "default": "dsnet"}
        decoded = {"offsets_dsnet": np.float32(0.6) * offsets, "offsets_autoencoder": 0 * offsets}
        put(run / "decode", decoded, SEQUENCES, **SMPL, **labels)
    (run / "corpus").mkdir(exist_ok=True)
    body.save_smpl_npz(run / "corpus" / "SMPL_FEMALE.npz")


@pytest.fixture(autouse=True)
def _runs(tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    monkeypatch.setattr(MODEL_PATH, lambda run: "embedded:female")


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """The artifact `evaluate` of a run with two pipelines, made once."""
    runs = tmp_path_factory.mktemp("runs")
    forge(runs / "both")
    write_best_pipeline(runs / "both", share=0.5)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DSNET_RUNS", str(runs))
        patch.setattr(MODEL_PATH, lambda run: "embedded:female")
        return evaluated()


def evaluated(run="both"):
    evaluate_run(Run(run))
    return Run(run).artifact("evaluate")


def test_every_group_holds_both_pipelines(both):
    manifest = both.manifest
    assert [cell for cell in manifest["cells"] if cell in FOUR] == FOUR
    own = ["dsnet_plus", "dsnet", "autoencoder", "person_mean", "sequence_mean", "smpl",
           "person_mean_best", "smpl_best"]  # fmt: skip
    assert list(manifest["predictors"]) == own
    for cell in FOUR:
        assert set(manifest["cells"][cell]) == {*own} - {"autoencoder"}
        assert manifest["cells"][cell][PLUS]["offsets"]["r2"] == pytest.approx(0.75, abs=1e-5)
        assert manifest["cells"][cell]["dsnet"]["offsets"]["r2"] == pytest.approx(0.84, abs=1e-5)
        assert manifest["cells"][cell][PLUS]["velocity"]["r2"] == pytest.approx(0.75, abs=1e-4)
    assert manifest["default"] == PLUS
    assert manifest["pipelines"]["paper"]["default"] == "dsnet"
    assert manifest["pipelines"]["best"]["alignment"] == "align_robust"
    assert set(manifest["alignments"]) == {"align", "align_robust"}
    best, paper = (manifest["alignments"][name]["betas_rms"] for name in ("align_robust", "align"))
    assert best == 0
    assert paper == pytest.approx(0.2, rel=1e-4)


@pytest.mark.parametrize("name", ["50004_kicking", "99001_hips", "50004_one_leg_jump"])
def test_each_pipeline_is_posed_with_its_own_motion(both, name):
    body = load_body_model("embedded:female")
    found = next(s for s in both.manifest["per_sequence"] if s["name"] == name)["errors"]

    def mesh(stage, array=None, given=None):
        """Posed by the slow oracle with one artifact's motion and perhaps another's offsets."""
        artifact = read_artifact(both.path.parent / stage)
        place = next(s for s in sequences_of(artifact) if s.name == name)
        subjects = list(dict.fromkeys(s.subject for s in sequences_of(artifact)))
        pose, trans = unpack_theta(artifact.array("theta")[place.frames])
        shapes = np.repeat(
            artifact.array("betas")[subjects.index(place.subject)][None], len(pose), axis=0
        )
        holder = read_artifact(both.path.parent / (given or stage))
        own = next(s for s in sequences_of(holder) if s.name == name)
        offsets = None if array is None else holder.array(array)[own.frames].astype(float)
        return pose_vertices(body, shapes, pose, trans, offsets)

    aligned = name == "50004_one_leg_jump"
    for predictor, motions, holder, alignment in (
        (PLUS, "infer_plus", "infer_plus", "align_robust"),
        ("dsnet", "infer", "decode", "align"),
    ):
        real = mesh(alignment if aligned else "truth", "offsets")
        predicted = mesh(motions, f"offsets_{predictor}", holder)
        error_mm = 1e3 * np.linalg.norm(predicted - real, axis=-1)
        r2 = 1 - np.square(predicted - real).sum() / np.square(mesh(motions) - real).sum()
        assert found[predictor]["mesh"]["mean_mm"] == pytest.approx(error_mm.mean(), rel=1e-5)
        assert found[predictor]["mesh"]["max_mm"] == pytest.approx(error_mm.max(), rel=1e-5)
        assert found[predictor]["mesh"]["r2"] == pytest.approx(r2, rel=1e-4)


def test_how_offsets_move_is_measured(both):
    plus = both.manifest["cells"]["new_person_unseen_motion"][PLUS]
    assert plus["spectrum"]["own"]["hz"] == pytest.approx(5.25, abs=0.5)
    assert plus["spectrum"]["own"]["ratio"] == pytest.approx(0.5, rel=1e-4)
    true, predicted = (
        per_frame_m(both, OFFSET_SIZE, name, "99001_stopping") for name in ("true", PLUS)
    )
    assert true is not None
    assert predicted is not None
    np.testing.assert_allclose(predicted, 0.5 * true, rtol=1e-5)
    assert per_frame_m(both, OFFSET_SIZE, "smpl", "99001_stopping") is None


def test_a_captured_truth_is_judged_whole_and_in_parts(tmp_path):
    forge(tmp_path / "both", captured=True)
    write_best_pipeline(tmp_path / "both", share=0.5, static_share=0.9)
    manifest = evaluated().manifest
    assert manifest["test_bed"] == {
        "tissue": "own", "form": "captured", "gravity": True, "gender": "female"
    }  # fmt: skip
    truth = Run("both").artifact("truth")
    frames = slice(25, 34)
    moving, static = (truth.array(key)[frames].astype(float) for key in ("offsets", "static"))
    errors = manifest["cells"]["known_person_unseen_motion"]
    plus, dsnet = errors[PLUS], errors["dsnet"]
    total = np.square(0.5 * moving + 0.1 * static).sum() / np.square(moving + static).sum()
    assert plus["offsets"]["r2"] == pytest.approx(1 - total, rel=1e-5)
    assert plus["moving"]["r2"] == pytest.approx(0.75, rel=1e-5)
    assert plus["static"]["r2"] == pytest.approx(0.99, rel=1e-5)
    assert plus["velocity"]["r2"] == pytest.approx(0.75, rel=1e-4)
    # DSNet tells no static part: all that it predicts is taken to move.
    assert "static" not in dsnet
    assert dsnet["moving"]["r2"] == pytest.approx(0.84, rel=1e-5)
    alignment = manifest["alignments"]["align"]["offsets"]["r2"]
    whole = (truth.array("offsets")[:16] + truth.array("static")[:16]).astype(float)
    lost = np.square(truth.array("static")[:16]).sum(dtype=float) / np.square(whole).sum()
    assert alignment == pytest.approx(1 - lost, rel=1e-4)


@pytest.mark.parametrize("pipeline", ["paper", "best"])
def test_one_pipeline_is_enough(tmp_path, pipeline):
    forge(tmp_path / "both", paper=pipeline == "paper")
    if pipeline == "best":
        write_best_pipeline(tmp_path / "both", own_alignment=False)
    evaluate = evaluated()
    own = {"paper": "dsnet", "best": PLUS}[pipeline]
    assert list(evaluate.manifest["pipelines"]) == [pipeline]
    assert evaluate.manifest["default"] == own
    assert set(evaluate.manifest["alignments"]) == {"align"}
    beside = ["person_mean", "sequence_mean", "smpl"]
    assert [name for name in evaluate.manifest["predictors"] if name != "autoencoder"] == [
        own, *beside
    ]  # fmt: skip
    assert (
        set(evaluate.manifest["upstream"])
        == {
            "paper": {"align", "infer", "decode", "truth"},
            "best": {"align", "infer_plus", "truth"},
        }[pipeline]
    )


def test_without_a_truth_aligned_offsets_are_each_pipelines_own(tmp_path):
    forge(tmp_path / "both")
    write_best_pipeline(tmp_path / "both")
    shutil.rmtree(tmp_path / "both" / "truth")
    manifest = evaluated().manifest
    assert manifest["test_bed"] is None
    assert set(manifest["cells"]) == {"validation", "train"}
    errors = manifest["cells"]["validation"]
    # The robust alignment is forged a tenth of a millimetre off in each coordinate.
    assert errors[PLUS]["velocity"]["r2"] > 0.9
    assert errors["dsnet"]["offsets"]["r2"] == pytest.approx(0.84, rel=1e-5)
    assert errors[PLUS]["offsets"]["r2"] != pytest.approx(0.99, rel=1e-5)


def test_half_a_prediction_is_not_evaluated_without(tmp_path):
    forge(tmp_path / "both", paper=False)
    write_best_pipeline(tmp_path / "both")
    (tmp_path / "both" / ".decode.partial").mkdir()
    with pytest.raises(DsnetError, match="dsnet decode"):
        evaluate_run(Run("both"))
