"""The corpus as a stage: what readers find, resuming, and the truth kept apart."""

from __future__ import annotations

from dataclasses import replace

import h5py
import numpy as np
import pytest
import torch

from bridge.body import load_body_model
from bridge.body.posing import shaped_vertices
from bridge.meshes.dyna_files import dyna_sequences
from bridge.motion import sequences_of, subject_rows, unpack_theta
from bridge.motion.readers import subject_and_motion
from bridge.motion.splits import CELLS, cell_of, trained_people_and_kinds
from bridge.runs import read_artifact
from dsnet.synthetic import stage_corpus as stage
from dsnet.synthetic.simulation import TissueSimulator
from dsnet.synthetic.subjects import SUBJECTS
from tests.forged.amass import load_amass_motion
from torch_align_ae.body import SMPL, unpose

TINY = stage.CorpusConfig(
    run="tiny",
    subjects=1,
    motions=("one_leg_jump",),
    mean_frames=66,
    mosh_motions=("side_to_side_hopping",),
    mosh_seconds=1.0,
    retakes=1,
    crossing="rotating",
)


@pytest.fixture(scope="module")
def config():
    return TINY


def test_unposing_the_meshes_by_the_truth_gives_the_true_offsets(corpus, truth):
    smpl = SMPL(load_body_model(corpus.file("SMPL_FEMALE.npz")), dtype=torch.float64)
    rows = subject_rows(sequences_of(truth))
    theta, offsets, betas = (truth.array(name) for name in ("theta", "offsets", "betas"))
    meshes_of = {one.name: one for one in dyna_sequences([corpus.file("dyna_female.h5")])}
    assert len(meshes_of) == 1
    for sequence in sequences_of(corpus):
        meshes = torch.from_numpy(meshes_of[sequence.name].read()).double()
        pose, trans = (torch.tensor(part).double() for part in unpack_theta(theta[sequence.frames]))
        shape = torch.tensor(betas[rows[sequence.subject]]).double().expand(len(pose), -1)
        rest = smpl.rest_vertices(shape, pose)
        found = (unpose(smpl, meshes, shape, pose, trans) - rest).numpy()
        np.testing.assert_allclose(found, offsets[sequence.frames], atol=2e-6)
        assert np.abs(offsets[sequence.frames]).max() > 5e-3


def test_mosh_files_read_back_as_the_true_motion(corpus, truth):
    rows = subject_rows(sequences_of(truth))
    tests = [sequence for sequence in sequences_of(truth) if sequence.split == "test"]
    assert [sequence.name for sequence in tests] == [
        "50004_side_to_side_hopping",
        "50004_one_leg_jump_take2",
        "99001_side_to_side_hopping",
        "99003_one_leg_jump",
    ]
    data = load_body_model(corpus.file("SMPL_FEMALE.npz"))
    for sequence in tests:
        path = corpus.file(f"mosh/{sequence.name}_poses.npz")
        betas = truth.array("betas")[rows[sequence.subject]]
        joint_m = (data.J_regressor @ (data.v_template + data.shapedirs @ betas.astype(float)))[0]
        motion = load_amass_motion(path, root_joint_m=joint_m)
        assert (motion.source_fps, motion.gender) == (100.0, "female")
        np.testing.assert_array_equal(motion.betas, betas)
        np.testing.assert_allclose(motion.theta, truth.array("theta")[sequence.frames], atol=1e-5)
        assert np.abs(truth.array("offsets")[sequence.frames]).max() > 5e-3


def test_motions_begin_with_settled_tissue(truth):
    """Nobody moves at first: gravity holds the tissue of lowered arms where it is."""
    for sequence in sequences_of(truth):
        first = truth.array("offsets")[sequence.start : sequence.start + 4]
        np.testing.assert_allclose(first[1:], first[:1].repeat(3, axis=0), atol=2e-6)
        assert 1e-5 < np.abs(first).max() < 0.05


def test_everything_says_synthetic(corpus, truth):
    assert corpus.origin == truth.origin == "synthetic"
    with h5py.File(corpus.file("dyna_female.h5")) as file:
        assert file.attrs["source"] == "synthetic"
    with np.load(corpus.file("mosh/99001_side_to_side_hopping_poses.npz")) as motion:
        assert motion["source"] == "synthetic"
    assert corpus.file("NOTICE.txt").read_text().startswith("Synthetic data.")
    assert load_body_model(corpus.file("SMPL_FEMALE.npz")).source == "synthetic"


def test_no_mesh_of_a_test_take_is_in_the_corpus(corpus, truth):
    names = {sequence.name for sequence in sequences_of(truth) if sequence.split == "test"}
    found = dyna_sequences([corpus.file("dyna_female.h5")])
    assert not names & {sequence.name for sequence in found}
    assert not corpus.manifest["arrays"]
    assert {sequence.split for sequence in sequences_of(corpus)} == {"train"}
    # What a test take leaves there is its motion: an AMASS file, which holds no vertices.
    assert {name for name in corpus.manifest["files"] if name.startswith("mosh/")} == {
        f"mosh/{name}_poses.npz" for name in names
    }
    for name in names:
        with np.load(corpus.file(f"mosh/{name}_poses.npz")) as motion:
            assert not motion["dmpls"].any()
            assert 6890 not in {size for key in motion.files for size in motion[key].shape}


def test_people_and_kinds_come_back_from_the_names_of_the_files(corpus, truth):
    trained = trained_people_and_kinds(sequences_of(corpus))
    found = set()
    for sequence in sequences_of(truth):
        if sequence.split == "test":
            path = corpus.file(f"mosh/{sequence.name}_poses.npz")
            assert subject_and_motion(path) == (sequence.subject, sequence.motion)
            found.add(cell_of(sequence, *trained))
    assert found == set(CELLS)


def test_a_killed_run_goes_on_with_more_cores_and_ends_bit_identical(
    finished, tmp_path, monkeypatch
):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    simulate, lengths = TissueSimulator.offsets, []

    def killed_at_the_third(self, theta, fps):
        if len(lengths) == 2:
            raise KeyboardInterrupt
        lengths.append(len(theta))
        return simulate(self, theta, fps)

    monkeypatch.setattr(TissueSimulator, "offsets", killed_at_the_third)
    with pytest.raises(KeyboardInterrupt):
        stage.main(TINY)
    assert not (tmp_path / "tiny" / "truth").exists()

    resumed = []
    monkeypatch.setattr(stage, "usable_cores", lambda: 16)
    monkeypatch.setattr(
        TissueSimulator,
        "offsets",
        lambda self, theta, fps: resumed.append(len(theta)) or simulate(self, theta, fps),
    )
    stage.main(TINY)
    assert len(resumed) == len(sequences_of(read_artifact(finished / "truth"))) - 2
    for name in ("truth", "corpus"):
        whole, again = read_artifact(finished / name), read_artifact(tmp_path / "tiny" / name)
        assert whole.content_sha256 == again.content_sha256


def test_men_have_a_corpus_of_their_own(tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    stage.main(replace(TINY, gender="male", mosh_motions=(), retakes=0))
    corpus = read_artifact(tmp_path / "tiny/corpus")
    assert [sequence.name for sequence in sequences_of(corpus)] == ["50002_one_leg_jump"]
    assert corpus.manifest["gender"] == "male"
    body = load_body_model(corpus.file("SMPL_MALE.npz"))
    assert body.gender == "male"
    (sequence,) = dyna_sequences([corpus.file("dyna_male.h5")])
    meshes = sequence.read()
    height_m = np.ptp(shaped_vertices(body, SUBJECTS["male"][0].betas[None])[0][:, 1])
    assert 0.9 * height_m < np.ptp(meshes[0][:, 1]) < 1.01 * height_m


@pytest.mark.parametrize(
    "options",
    [
        ["--motions"],
        ["--motions", "hips", "hips"],
        ["--mosh-seconds", "nan"],
        ["--mosh-seconds", "inf"],
        ["--mosh-seconds", "0.9"],
        ["--mean-frames", "59"],
        ["--subjects", "-1"],
        ["--subjects", "6"],
    ],
)
def test_options_without_sense_are_refused_before_any_work(options, tmp_path, monkeypatch, refusal):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    monkeypatch.setattr(TissueSimulator, "offsets", lambda *_: pytest.fail("it began"))
    refusal("corpus", "--profile", "smoke", *options)
    assert not list(tmp_path.glob("smoke/*"))
