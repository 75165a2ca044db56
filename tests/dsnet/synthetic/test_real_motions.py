"""Real motions as test takes: who does them, what is simulated, what the files say."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bridge.body import load_body_model
from bridge.body.model_data import SMPL_JOINT_NAMES, SMPL_PARENTS
from bridge.body.posing import shaped_joints
from bridge.motion import sequences_of, subject_rows, unpack_theta
from bridge.motion.resampling import load_motion
from bridge.runs import read_artifact
from dsnet.synthetic import stage_corpus as stage
from dsnet.synthetic.corpus_motions import CorpusMotions
from tests.dsnet.synthetic.test_stage_corpus import TINY as TINY_STAGE
from tests.forged.amass import load_amass_motion, save, shape, smplh
from tests.forged.bvh import Skeleton, text, world_of
from tests.forged.lively import lively

TINY = replace(TINY_STAGE, mosh_motions=(), retakes=0)
SAMPLE = Path(os.environ.get("DSNET_TEST_DATA", "nowhere")) / "amass" / "dmpl_sample.npz"


@pytest.fixture(scope="module")
def amass(tmp_path_factory):
    """A man's motion at 120 fps, beside what is no motion and what is too short to use."""
    folder = tmp_path_factory.mktemp("amass")
    poses = 0.3 * np.sin(np.linspace(0, 15, 181))[:, None] * np.linspace(0, 1, 156)
    poses[:, 0] += np.pi / 2  # upright, z up
    save(folder / "MPI/00017/leg throw_poses.npz", smplh(181, 120.0), gender="male", poses=poses)
    save(folder / "MPI/00017/shape.npz", shape())
    save(folder / "MPI/00017/short_poses.npz", smplh(30, 120.0))
    return folder


@pytest.fixture(scope="module")
def made(amass, tmp_path_factory):
    runs = tmp_path_factory.mktemp("runs")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DSNET_RUNS", str(runs))
        stage.main(replace(TINY, amass=amass, amass_seconds=1.2))
    return read_artifact(runs / "tiny/truth"), read_artifact(runs / "tiny/corpus")


def test_a_known_and_a_new_person_follow_the_motion_about_their_own_root(made, amass):
    truth, corpus = made
    tests = [sequence for sequence in sequences_of(truth) if sequence.split == "test"]
    assert [(sequence.name, sequence.length) for sequence in tests] == [
        ("50004_amass_leg_throw", 73),
        ("99001_amass_leg_throw", 73),
    ]
    rows, data = subject_rows(sequences_of(truth)), load_body_model(corpus.file("SMPL_FEMALE.npz"))
    for sequence in tests:
        betas = truth.array("betas")[rows[sequence.subject]].astype(float)
        joint_m = shaped_joints(data, betas[None])[0, 0]
        theta = truth.array("theta")[sequence.frames]
        source = amass / "MPI/00017/leg throw_poses.npz"
        real = load_amass_motion(source, root_joint_m=joint_m).theta[:73]
        np.testing.assert_allclose(theta, real, atol=1e-5)
        path = corpus.file(f"mosh/{sequence.name}_poses.npz")
        read = load_amass_motion(path, root_joint_m=joint_m)
        np.testing.assert_allclose(theta, read.theta, atol=1e-5)
        np.testing.assert_array_equal(read.betas, betas)
        assert read.gender == "female"
        assert np.abs(truth.array("offsets")[sequence.frames]).max() > 1e-3


def test_the_corpus_stays_synthetic_and_names_the_motions_source(made):
    truth, corpus = made
    assert corpus.origin == truth.origin == "synthetic"
    assert corpus.manifest["real_motions"] == {"amass_leg_throw": "leg throw_poses.npz"}
    assert "taken from: leg throw_poses.npz" in corpus.file("NOTICE.txt").read_text()
    with np.load(corpus.file("mosh/99001_amass_leg_throw_poses.npz")) as motion:
        assert motion["source"] == "synthetic body, motion of leg throw_poses.npz"
    assert {"motion_0", "motion_1"} <= set(truth.manifest["upstream"])
    assert {"motion_0", "motion_1", "truth"} == set(corpus.manifest["upstream"])


def test_what_is_too_short_is_left_out_with_a_line(amass, capsys):
    assert len(stage.plan_of(replace(TINY, amass=amass)).held_out) == 2
    assert "short_poses.npz: left out; shorter than 1 s" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("asked", "suffix", "source_fps"),
    [
        ({"amass_fps": 40.0}, "at_40_hz", 40.0),
        ({"amass_smooth_hz": 8.0}, "smoothed_8_hz", 120.0),
        ({"amass_smooth_hz": "auto"}, "smoothed", 120.0),
    ],
)
def test_another_rate_and_smoothing_are_the_takes_and_in_its_name(
    amass, tmp_path, asked, suffix, source_fps
):
    known, _ = stage.plan_of(replace(TINY, amass=amass, amass_seconds=1.2, **asked)).held_out
    assert known.name == f"50004_amass_leg_throw_{suffix}"
    assert known.source_fps == source_fps
    motions = CorpusMotions(load_body_model("embedded:female"), seed=0)
    motions.write_amass(tmp_path / "take.npz", known)
    assert known.source is not None
    fps, smooth_hz = asked.get("amass_fps"), asked.get("amass_smooth_hz")
    made = load_motion(tmp_path / "take.npz", fps)
    own = load_motion(known.source, fps, smooth_hz=smooth_hz)
    assert made.source_fps == source_fps
    np.testing.assert_allclose(made.theta[:, 3:66], own.theta[: len(made.theta), 3:66], atol=1e-4)


def test_a_real_motion_that_falls_as_nobody_can_is_taken_with_a_line(tmp_path, capsys):
    trans = np.zeros((181, 3))
    trans[:, 2] = 0.25 * np.abs(np.sin(np.arange(181) / 10))
    save(tmp_path / "fast.npz", smplh(181, 120.0), trans=trans)
    assert len(stage.plan_of(replace(TINY, amass=tmp_path)).held_out) == 2
    said = capsys.readouterr().err
    assert "fast.npz falls with" in said
    assert "--amass-fps" in said
    assert len(stage.plan_of(replace(TINY, amass=tmp_path, amass_fps=60.0)).held_out) == 2
    assert capsys.readouterr().err == ""


def test_a_real_motion_is_used_up_to_its_first_jump_with_a_line(tmp_path, capsys):
    trans = np.zeros((361, 3))
    trans[180:] = 2.0
    save(tmp_path / "joined.npz", smplh(361, 120.0), trans=trans)
    takes = stage.plan_of(replace(TINY, amass=tmp_path)).held_out
    assert [take.frame_count for take in takes] == [180, 180]
    assert "joined.npz: used up to 1.50 s, as it jumps there" in capsys.readouterr().err


def test_a_changed_file_makes_the_truth_anew(made, tmp_path, monkeypatch):
    shutil.copytree(made[0].path.parent.parent, tmp_path / "runs")
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))
    poses = np.linspace(0, 0.5, 181)[:, None] * np.ones(156)
    save(tmp_path / "amass/leg throw_poses.npz", smplh(181, 120.0), poses=poses)
    stage.main(replace(TINY, amass=tmp_path / "amass", amass_seconds=1.2))
    again = read_artifact(tmp_path / "runs/tiny/truth")
    assert again.content_sha256 != made[0].content_sha256
    assert again.manifest["upstream"] != made[0].manifest["upstream"]


def test_files_of_one_name_are_kinds_of_their_own(tmp_path):
    for name in ("CMU/03/leg throw", "CMU/03/leg-throw", "MPI/00017/leg throw"):
        save(tmp_path / f"{name}_poses.npz", smplh(181, 120.0))
    kinds = {take.kind for take in stage.plan_of(replace(TINY, amass=tmp_path)).held_out}
    assert kinds == {"amass_leg_throw", "amass_leg_throw_2", "amass_leg_throw_3"}


def test_a_bvh_is_a_take_too_from_the_end_of_its_rest_pose_on(tmp_path, capsys):
    theta = 0.3 * lively(181)
    pose, trans_m = unpack_theta(theta.copy())
    pose[0] = np.pi / 4
    data = load_body_model("embedded:female")
    skeleton = Skeleton(SMPL_JOINT_NAMES, SMPL_PARENTS, shaped_joints(data, np.zeros((1, 10)))[0])
    path = tmp_path / "05_06.bvh"
    path.write_text(text(skeleton, world_of(pose), trans_m, fps=120.0))
    known, new = stage.plan_of(replace(TINY, amass=tmp_path)).held_out
    assert [take.name for take in (known, new)] == ["50004_bvh_05_06", "99001_bvh_05_06"]
    assert (known.frame_count, known.source_fps) == (180, pytest.approx(120))
    assert "05_06.bvh: the motion begins after frame 1 of the file" in capsys.readouterr().err
    read = CorpusMotions(data, 0).as_read_back(new)
    # Frames 1, 3, 5, ... of the file.
    np.testing.assert_allclose(read[:, 3:66], theta[1::2, 3:66], atol=1e-5)


@pytest.mark.licensed
@pytest.mark.skipif(not SAMPLE.is_file(), reason="no $DSNET_TEST_DATA/amass/dmpl_sample.npz")
def test_the_sample_of_amass_is_done_by_a_known_and_a_new_person():
    plan = stage.plan_of(replace(TINY, amass=SAMPLE.parent))
    assert plan.files == [SAMPLE]
    names = ["50004_amass_dmpl_sample", "99001_amass_dmpl_sample"]
    assert [take.name for take in plan.held_out] == names
    motions = CorpusMotions(load_body_model("embedded:female"), 0)
    known, new = map(motions.as_read_back, plan.held_out)
    assert known.shape == new.shape == (118, 69)
    np.testing.assert_allclose(known[:, :66], new[:, :66], atol=1e-6)
    # The same pose, about each person's own root joint.
    assert np.abs(known[:, 66:] - new[:, 66:]).max() > 1e-4
