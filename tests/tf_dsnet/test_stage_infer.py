"""Stage `infer`: by networks, and by `dsnet_plus`."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body import load_body_model
from bridge.exchange import save_weights
from bridge.exchange.dsnet import TrainedDsnet
from bridge.motion import sequences_of, subject_rows
from bridge.motion.splits import cell_of
from bridge.runs import Artifact, ArtifactWriter, Run, read_artifact
from bridge.runs.artifact import content_digest
from bridge.runs.files import MANIFEST
from bridge.tissue.nodes import TissueNodes
from bridge.tissue.trained_plus import StaticPart, TrainedPlus
from dsnet.stages import run_motions, stage_infer
from dsnet.stages.stage_infer import InferConfig, TrainedNetworks, infer_plus
from dsnet.stream.streaming_predictor import StreamingPredictor
from dsnet.verify.reference.oscillators import node_offsets
from tests.forged.amass import save, shape, smplh, smplx
from tests.forged.oscillating import people_of, true_model
from tests.forged.plus import write_plus
from tests.tf_dsnet.plus import PEOPLE, forge_run


@pytest.fixture
def trained(encoded_run: Path, trained_dsnet: TrainedDsnet) -> Artifact:
    """Run `tiny` with a `train` whose two predictors have different weights."""
    halved = {name: 0.5 * array for name, array in trained_dsnet.weights.items()}
    write_trained(
        encoded_run, {"dsnet_standardised": trained_dsnet.arrays(), "dsnet_faithful": halved}
    )
    return read_artifact(encoded_run / "train")


def write_trained(run: Path, weights: dict[str, dict[str, np.ndarray]]) -> None:
    writer = ArtifactWriter(run / "train", "train", data="synthetic")
    for name, arrays in weights.items():
        save_weights(writer.file_path(f"{name}.safetensors"), arrays)
    labels = {name: {"label": name.replace("_", " ")} for name in weights}
    writer.record(default=next(iter(weights)), predictors=labels)
    writer.finish()


def streamed(name: str, theta, betas):
    predictor = StreamingPredictor("tiny", name)
    return np.stack([predictor.step(frame[None], betas[None])[0] for frame in theta])


def forge_mosh(run: Path, names: tuple[str, ...]) -> None:
    """A corpus with 50 frames at 100 fps for each name, turned to z up."""
    writer = ArtifactWriter(run / "corpus", "corpus", data="synthetic")
    rng = np.random.default_rng(1)
    for index, name in enumerate(names):
        poses = np.zeros((51, 156))
        poses[:, 0] = np.pi / 2
        poses[:, 3:66] = 0.1 * rng.normal(size=63)
        np.savez(
            writer.file_path(f"mosh/{name}_poses.npz"),
            poses=poses,
            trans=np.tile([0.0, 0.0, 0.95], (51, 1)),
            betas=np.full(16, float(index + 1)),
            gender="female",
            mocap_framerate=100.0,
            source="synthetic",
        )
    writer.finish()


def test_stage_predicts_every_frame_by_both_predictors(trained, encoded_run):
    stage_infer.main(InferConfig("tiny"))
    made = read_artifact(encoded_run / "infer")
    encoded = read_artifact(encoded_run / "encode")
    assert made.manifest["sequences"] == encoded.manifest["sequences"]
    np.testing.assert_array_equal(made.array("theta"), encoded.array("theta"))
    np.testing.assert_array_equal(made.array("betas"), encoded.array("betas"))
    last = sequences_of(made)[-1]
    for name in ("dsnet_standardised", "dsnet_faithful"):
        expected = streamed(name, made.array("theta")[last.frames], made.array("betas")[1])
        found = made.array(f"latents_{name}")[last.frames]
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=2e-5)
    assert made.manifest["default"] == "dsnet_standardised"
    assert made.manifest["predictors"] == {
        "dsnet_standardised": "dsnet standardised",
        "dsnet_faithful": "dsnet faithful",
    }


@pytest.mark.parametrize(("source", "used"), [("synthetic", 1.0), ("AMASS", 0.0)])
def test_people_in_a_flat_amass_folder_keep_their_own_shapes(
    trained, encoded_run, tmp_path, monkeypatch, source, used
):
    """None of the files is in a folder of its subject, so all are called alike. The body is an
    embedded one, on which betas of others mean nothing."""
    folder = tmp_path / "flat"
    for number, name in enumerate(("jump", "run", "walk")):
        save(folder / f"{name}_poses.npz", smplh(), betas=np.full(16, float(number // 2 + 1)),
             source=source)  # fmt: skip
    monkeypatch.setattr(run_motions, "body_model_path", lambda run: "embedded:female")
    stage_infer.main(InferConfig("tiny", amass=folder))
    made = read_artifact(encoded_run / "infer")
    sequences, rows = sequences_of(made), subject_rows(sequences_of(made))
    people = [sequence.subject for sequence in sequences[-3:]]
    assert people == ["flat", "flat", "flat-2"]
    shapes = [made.array("betas")[rows[person]] for person in people]
    expected = used * np.repeat([[1.0], [1.0], [2.0]], 10, axis=1)
    np.testing.assert_array_equal(shapes, expected)


def test_unseen_motions_follow_with_fitted_or_stored_shapes(trained, encoded_run, monkeypatch):
    forge_mosh(encoded_run, ("50004_kicking", "99001_side_to_side_hopping"))
    monkeypatch.setattr(run_motions, "body_model_path", lambda run: "embedded:female")
    stage_infer.main(InferConfig("tiny"))
    made = read_artifact(encoded_run / "infer")
    encoded = read_artifact(encoded_run / "encode")
    known, unknown = sequences_of(made)[-2:]
    assert (known.name, unknown.name) == ("50004_kicking", "99001_side_to_side_hopping")
    assert {(s.split, s.fps, s.length) for s in (known, unknown)} == {("test", 60.0, 31)}
    assert (known.start, unknown.start) == (195, 226)
    assert len(made.array("latents_dsnet_faithful")) == len(made.array("theta")) == 257
    rows, betas = subject_rows(sequences_of(made)), made.array("betas")
    np.testing.assert_array_equal(betas[rows["50004"]], encoded.array("betas")[0])
    np.testing.assert_array_equal(betas[rows["99001"]], np.full(10, 2.0))
    root = made.array("theta")[known.frames, :3]
    np.testing.assert_allclose(root, 0, atol=1e-6)


def test_second_takes_and_real_motions_keep_their_names_and_cells(
    trained, encoded_run, monkeypatch
):
    names = ("50004_hips_take2", "99003_amass_dmpl_sample", "99005_hips")
    forge_mosh(encoded_run, names)
    monkeypatch.setattr(run_motions, "body_model_path", lambda run: "embedded:female")
    stage_infer.main(InferConfig("tiny"))
    found = sequences_of(read_artifact(encoded_run / "infer"))[-3:]
    assert [(s.name, s.subject, s.motion) for s in found] == [
        ("50004_hips_take2", "50004", "hips_take2"),
        ("99003_amass_dmpl_sample", "99003", "amass_dmpl_sample"),
        ("99005_hips", "99005", "hips"),
    ]
    assert [cell_of(sequence, {"50004"}, {"hips"}) for sequence in found] == [
        "known_person_known_motion",
        "new_person_unseen_motion",
        "new_person_known_motion",
    ]


def test_motions_enter_the_decision_whether_the_stage_is_current(trained, encoded_run, monkeypatch):
    monkeypatch.setattr(run_motions, "body_model_path", lambda run: "embedded:female")
    counts = []
    for names in (("50004_kicking",), ("50004_kicking", "50020_kicking")):
        forge_mosh(encoded_run, names)
        stage_infer.main(InferConfig("tiny"))
        counts.append(len(sequences_of(read_artifact(encoded_run / "infer"))))
    assert counts == [7, 8]


def test_a_corpus_beside_licensed_meshes_is_not_predicted(trained, encoded_run):
    """A run's name may be used again, for licensed files after the synthetic ones."""
    forge_mosh(encoded_run, ("50004_kicking",))
    path = encoded_run / "encode" / MANIFEST
    manifest = json.loads(path.read_text()) | {"data": "licensed"}
    path.write_text(json.dumps(manifest | {"sha256": content_digest(manifest)}))
    stage_infer.main(InferConfig("tiny"))
    made = read_artifact(encoded_run / "infer")
    assert {sequence.split for sequence in sequences_of(made)} == {"train", "validation"}


def test_a_folder_of_amass_is_predicted(trained, encoded_run, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(run_motions, "body_model_path", lambda run: "embedded:female")
    save(tmp_path / "MPI_mosh/50004/kicking_poses.npz", smplh(51, 100.0))
    save(tmp_path / "MPI_mosh/50004/shape.npz", shape())
    save(tmp_path / "MPI_mosh/50002/kicking_poses.npz", smplh(), gender="male")
    save(tmp_path / "MoSh/00008/misc_stageii.npz", smplx(61, 120.0))
    save(tmp_path / "DFaust_67/50004/50004_hips_poses.npz", smplh())
    save(tmp_path / "MPI_mosh/50004/hips_poses.npz", smplh(21, 100.0))
    stage_infer.main(InferConfig("tiny", amass=tmp_path))
    made = sequences_of(read_artifact(encoded_run / "infer"))
    tests = [(s.name, s.length) for s in made if s.split == "test"]
    assert tests == [("50004_hips_take2", 13), ("50004_kicking", 31), ("00008_misc", 31)]
    counts = "3 motions; left out: 1 of motions already there, 1 of male bodies, 1 without poses"
    assert counts in capsys.readouterr().err


def test_a_changed_list_makes_predictions_old(trained, encoded_run, tmp_path, monkeypatch):
    monkeypatch.setattr(run_motions, "body_model_path", lambda run: "embedded:female")
    for name in ("50004/kicking", "00008/misc"):
        save(tmp_path / f"amass/{name}_poses.npz", smplh())
    listed, found = tmp_path / "women.txt", []
    for name in ("50004_kicking", "00008_misc"):
        listed.write_text(name)
        if found:
            with pytest.raises(DsnetError, match=r"stage infer is older than '.*women\.txt'"):
                Run("tiny").artifact("infer")
        stage_infer.main(InferConfig("tiny", amass=tmp_path / "amass", amass_list=listed))
        made = sequences_of(Run("tiny").artifact("infer"))
        found += [sequence.name for sequence in made if sequence.split == "test"]
    assert found == ["50004_kicking", "00008_misc"]


def one_motion(encoded_run, monkeypatch):
    """What is encoded, and the one motion beside it: its file, and what that holds."""
    forge_mosh(encoded_run, ("50004_kicking",))
    monkeypatch.setattr(run_motions, "body_model_path", lambda run: "embedded:female")
    encoded = read_artifact(encoded_run / "encode")
    (path,) = run_motions.find_motions(Run("tiny"), None, encoded)
    with np.load(path) as stored:
        return encoded, path, dict(stored)


def test_a_folder_is_played_at_the_rate_that_is_asked_for(encoded_run, monkeypatch, capsys):
    encoded, path, _ = one_motion(encoded_run, monkeypatch)
    *_, stored = run_motions.gather(encoded, Run("tiny"), [path]).sequences
    *_, halved = run_motions.gather(encoded, Run("tiny"), [path], 50.0).sequences
    assert (stored.length, halved.length) == (31, 61)
    assert capsys.readouterr().err == ""


def test_a_rate_or_a_list_of_no_folder_is_one_line(encoded_run):
    with pytest.raises(DsnetError, match="--amass-fps 60 without --amass"):
        stage_infer.main(InferConfig(run="tiny", amass_fps=60.0))
    with pytest.raises(DsnetError, match=r"--amass-list women\.txt without --amass"):
        stage_infer.main(InferConfig(run="tiny", amass_list=Path("women.txt")))


def test_a_motion_with_a_cut_is_told_and_starts_anew(trained, encoded_run, monkeypatch, capsys):
    encoded, path, arrays = one_motion(encoded_run, monkeypatch)
    arrays["trans"] = arrays["trans"] + 2.0 * (np.arange(len(arrays["trans"])) >= 25)[:, None]
    save(path, arrays)
    motions = run_motions.gather(encoded, Run("tiny"), [path])
    assert "jumps at frame 15 (0.25 s)" in capsys.readouterr().err
    predictors = TrainedNetworks(trained, (), Path)
    vars(predictors)["by_name"] = {"counting": lambda theta, _: np.arange(len(theta))}
    jumps = motions.theta[motions.sequences[-1].frames]
    counted = predictors.latents("counting", jumps, motions.betas[-1])
    np.testing.assert_array_equal(counted, [*range(15), *range(16)])


def test_predictors_are_loaded_where_they_are_sent(trained):
    there = pickle.loads(pickle.dumps(TrainedNetworks(trained, ("dsnet_faithful",), Path)))
    assert "by_name" not in vars(there)
    assert list(there.by_name) == ["dsnet_faithful"]


def run_with_plus(runs: Path, monkeypatch: pytest.MonkeyPatch, *, static: bool) -> Path:
    """A run whose `train_plus` has differences between people and frames, and maybe a static part
    that is mostly constant."""
    run = forge_run(runs, monkeypatch)
    body, rng = load_body_model("embedded:female"), np.random.default_rng(5)
    even = true_model(TissueNodes.of(body, 60), people_of(PEOPLE))
    residual = rng.normal(scale=0.1, size=even.weights.residual.shape).astype(np.float32)
    taps = np.array([0.7, 0.3], np.float32)
    part = StaticPart(
        rng.normal(scale=0.01, size=(PEOPLE, body.vertex_count, 3)).astype(np.float32),
        rng.normal(scale=1e-4, size=(207, 60, 3)).astype(np.float32),
    )
    model = replace(
        even,
        weights=replace(even.weights, residual=residual, taps=taps),
        static=part if static else StaticPart.nothing(),
        look_ahead=1,
    )
    write_plus(Run("tiny"), model)
    return run


def test_evaluated_sequences_are_predicted_end_to_end(runs, monkeypatch):
    run = run_with_plus(runs, monkeypatch, static=False)
    infer_plus(InferConfig("tiny"))()
    made, align = (read_artifact(run / name) for name in ("infer_plus", "align_robust"))
    made.verify()
    # The first training sequence of each person, and the one held out.
    names = ["50000_hips", "50001_hips", "50001_running"]
    placed = sequences_of(made)
    assert [s.name for s in placed] == names
    assert [(s.start, s.length) for s in placed] == [(0, 50), (50, 50), (100, 45)]
    assert set(made.manifest["arrays"]) == {"offsets_dsnet_plus", "theta", "betas"}
    assert made.manifest["arrays"]["offsets_dsnet_plus"]["unit"] == "m"
    assert made.manifest["predictors"] == {"dsnet_plus": "soft flesh"}
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
        expected = model.nodes.spread(node_offsets(model, body, theta, people_of(PEOPLE)[person]))
        found = made.array("offsets_dsnet_plus")[one.frames]
        np.testing.assert_allclose(found, expected, atol=2e-6)


def test_the_static_part_is_in_the_whole_and_beside_it(runs, monkeypatch):
    run = run_with_plus(runs, monkeypatch, static=True)
    infer_plus(InferConfig("tiny"))()
    made = read_artifact(run / "infer_plus")
    total, static = (made.array(f"{n}_dsnet_plus") for n in ("offsets", "static"))
    assert static.shape == total.shape == (145, 6890, 3)
    assert made.manifest["arrays"]["static_dsnet_plus"]["unit"] == "m"
    model = TrainedPlus.load(read_artifact(run / "train_plus"))
    body, theta = load_body_model("embedded:female"), made.array("theta")[:50]
    moved = model.nodes.spread(node_offsets(model, body, theta, people_of(PEOPLE)[0]))
    np.testing.assert_allclose(total[:50] - static[:50], moved, atol=1e-6)
    assert np.abs(static).max() > 1e-3


def test_motions_of_known_and_new_people_follow(runs, monkeypatch, tmp_path):
    run = run_with_plus(runs, monkeypatch, static=True)
    save(tmp_path / "amass/50001/kicking_poses.npz", smplh(61, 120.0))
    save(tmp_path / "amass/50077/kicking_poses.npz", smplh(61, 120.0), betas=np.full(16, 0.5),
         source="synthetic")  # fmt: skip
    infer_plus(InferConfig("tiny", amass=tmp_path / "amass"))()
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
        infer_plus(InferConfig("tiny"))()
    assert "\n" not in str(caught.value)
    assert not (run / "infer_plus").exists()
