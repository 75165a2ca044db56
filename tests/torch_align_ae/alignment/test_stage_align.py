from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch

from bridge.body import load_body_model
from bridge.errors import DsnetError
from bridge.meshes.dyna_files import write_dyna
from bridge.motion import sequences_of, shape_rows, subject_shapes, unpack_theta
from bridge.runs import Run
from bridge.runs.run import best_alignment
from dsnet.stages.stage_check import CheckConfig
from dsnet.stages.stage_check import main as check
from torch_align_ae.alignment import corpus_fit, sgd
from torch_align_ae.alignment.robust import RobustFit, RobustSettings
from torch_align_ae.alignment.sgd import SgdFit
from torch_align_ae.alignment.stage_align import AlignConfig, main


@pytest.fixture
def runs(tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))
    return tmp_path / "runs"


@pytest.fixture
def config(corpus):
    return config_of(corpus)


def config_of(corpus):
    folder = corpus[0]
    return AlignConfig(
        run="t",
        smpl=folder / "SMPL_FEMALE.npz",
        dyna=(folder / "dyna.h5",),
        aligner="sgd",
        steps=4,
        first_frame_steps=20,
        shape_steps=20,
    )


def aligned(config):
    main(config)
    artifact = Run(config.run).artifact("align")
    names = ("betas", "theta", "offsets", "frame_error")
    return artifact, {name: np.array(artifact.array(name)) for name in names}


@pytest.fixture(scope="module")
def expected(corpus, tmp_path_factory):
    """What `config` makes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DSNET_RUNS", str(tmp_path_factory.mktemp("expected")))
        return aligned(config_of(corpus))


@pytest.mark.parametrize("stage", ["align", "align_robust"])
@pytest.mark.usefixtures("finished")
def test_rows_describe_their_frames(config, smpl, stage):
    """Posing what was found, offsets and all, must give back each mesh, in file order."""
    artifact = Run("t").artifact(stage)
    arrays = {name: np.array(artifact.array(name)) for name in artifact.manifest["arrays"]}
    assert {name: array.shape for name, array in arrays.items()} == {
        "betas": (2, 10),
        "theta": (58, 69),
        "offsets": (58, 6890, 3),
        "frame_error": (58,),
    }
    assert all(array.dtype == np.float32 for array in arrays.values())
    index = [(s.name, s.start, s.length, s.fps, s.split) for s in sequences_of(artifact)]
    assert index == [
        ("50004_hips", 0, 35, 60.0, "train"),
        ("50004_one_leg_jump", 35, 3, 60.0, "validation"),
        ("50020_hips", 38, 20, 60.0, "train"),
    ]
    assert artifact.origin == "synthetic"
    with h5py.File(config.dyna[0]) as file:
        for sequence in sequences_of(artifact):
            rows = sequence.frames
            pose, trans = map(torch.tensor, unpack_theta(arrays["theta"][rows]))
            row = {"50004": 0, "50020": 1}[sequence.subject]
            betas = torch.tensor(arrays["betas"][row]).expand(sequence.length, -1)
            mesh = np.moveaxis(np.asarray(file[sequence.name]), -1, 0)
            offsets = torch.tensor(arrays["offsets"][rows])
            np.testing.assert_allclose(smpl(betas, pose, trans, offsets), mesh, atol=2e-5)
            error = np.linalg.norm(smpl(betas, pose, trans).numpy() - mesh, axis=-1).mean(-1)
            np.testing.assert_allclose(arrays["frame_error"][rows], error, atol=1e-5)


def test_pose_is_tracked(runs, config, corpus):
    more = dataclasses.replace(config, steps=25, first_frame_steps=150, shape_steps=250)
    artifact, arrays = aligned(more)
    for sequence in sequences_of(artifact):
        _, _, trans = corpus[1][sequence.name]
        found = unpack_theta(arrays["theta"][sequence.frames])[1]
        np.testing.assert_allclose(found, trans, atol=0.02)
    assert arrays["frame_error"].mean() < 0.02


@pytest.mark.parametrize("damaged", [False, True])
def test_interrupted_run_ends_bit_identical(runs, config, expected, monkeypatch, damaged):
    mark_written = corpus_fit.mark_written

    def mark_and_stop(mark, digest):
        mark_written(mark, digest)
        raise KeyboardInterrupt

    again = dataclasses.replace(config, run="again")
    with monkeypatch.context() as stopping:
        stopping.setattr(corpus_fit, "mark_written", mark_and_stop)
        with pytest.raises(KeyboardInterrupt):
            main(again)
    partial = runs / "again" / ".align.partial"
    assert [path.name for path in partial.glob("checkpoints/*.done")] == ["0.done"]
    if damaged:
        np.load(partial / "made" / "offsets.npy", mmap_mode="r+")[3] += 1
    starts, fit = [], SgdFit.fit

    def noted(self, learned, groups, files):
        starts.extend([window.start for window in group] for group in groups)
        return fit(self, learned, groups, files)

    monkeypatch.setattr(SgdFit, "learn", lambda _: pytest.fail("it began anew"))
    monkeypatch.setattr(SgdFit, "fit", noted)
    _, found = aligned(again)
    for name, array in expected[1].items():
        np.testing.assert_array_equal(found[name], array)
    assert starts == ([[0, 0, 0], [32]] if damaged else [[32]])


def test_windows_leave_no_trace(runs, config, expected, monkeypatch):
    """Each window goes on from the pose that the one before ended with."""
    monkeypatch.setattr(sgd, "FRAMES_PER_WINDOW", 5)
    _, found = aligned(dataclasses.replace(config, run="short"))
    for name, array in expected[1].items():
        np.testing.assert_allclose(found[name], array, atol=1e-3)


def test_processes_give_the_same_bits(runs, config, expected, monkeypatch):
    monkeypatch.setattr(sgd, "_STEPS_WORTH_PROCESSES", 0)
    monkeypatch.setattr(sgd, "usable_cores", lambda: 2)
    _, found = aligned(dataclasses.replace(config, run="processes"))
    for name, array in expected[1].items():
        np.testing.assert_array_equal(found[name], array)


def test_a_sequence_alone_is_aligned_as_in_a_batch(runs, config, expected, tmp_path):
    _, together = expected
    alone = tmp_path / "alone.h5"
    with h5py.File(config.dyna[0]) as source, h5py.File(alone, "w") as target:
        source.copy("50020_hips", target)
    _, single = aligned(dataclasses.replace(config, run="alone", dyna=(alone,)))
    np.testing.assert_allclose(single["betas"][0], together["betas"][1], atol=1e-4)
    np.testing.assert_allclose(single["theta"], together["theta"][38:], atol=1e-3)
    np.testing.assert_allclose(single["offsets"], together["offsets"][38:], atol=1e-3)


def test_a_sequence_can_be_left_out(runs, config, capsys):
    names = [s.name for s in sequences_of(aligned(config)[0])]
    artifact, arrays = aligned(dataclasses.replace(config, leave_out=(names[0],)))
    assert [s.name for s in sequences_of(artifact)] == names[1:]
    assert len(arrays["theta"]) == sum(s.length for s in sequences_of(artifact))
    assert "1 of 3 sequences left out, as asked" in capsys.readouterr().err
    with pytest.raises(DsnetError, match=r"--leave-out 50004_hop; expected one of 5"):
        main(dataclasses.replace(config, leave_out=("50004_hop",)))


def test_each_sequence_may_have_its_own_shape(runs, config, expected):
    """What every stage after it reads: the shape of a sequence, and one of each person."""
    _, together = expected
    artifact, arrays = aligned(dataclasses.replace(config, betas_per="sequence"))
    sequences = sequences_of(artifact)
    people = [sequence.subject for sequence in sequences]
    assert len(arrays["betas"]) == len(sequences) > len(set(people)) == len(together["betas"])
    assert shape_rows(sequences, arrays["betas"]) == {
        sequence.name: row for row, sequence in enumerate(sequences)
    }
    person = max(people, key=people.count)
    own = arrays["betas"][[row for row, one in enumerate(people) if one == person]]
    shapes = subject_shapes(sequences, arrays["betas"])
    np.testing.assert_allclose(shapes[person], own.mean(0), rtol=1e-6)
    # The sequence that gives its person's shape is fitted as before, the others to their own.
    of_person = subject_shapes(sequences, together["betas"])[person]
    np.testing.assert_allclose(own[0], of_person, atol=1e-5)
    assert np.abs(own[1:] - of_person).max() > 1e-4


def test_pytorchs_own_sgd_aligns_alike(runs, config, expected):
    _, arrays = aligned(dataclasses.replace(config, stock=True))
    for name, array in expected[1].items():
        np.testing.assert_allclose(arrays[name], array, atol=2e-5, err_msg=name)


def test_the_last_iterate_may_be_the_fit(runs, config, expected):
    last = aligned(dataclasses.replace(config, iterate="last"))[1]
    assert 1e-4 < np.abs(last["theta"] - expected[1]["theta"]).max() < 0.5


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"smpl": None, "dyna": ()}, "corpus"),
        ({"dyna": ()}, r"--smpl without --dyna.*the run's own corpus"),
        ({"smpl": None}, "--dyna without --smpl"),
        ({"dyna": (Path("none.h5"),)}, "no such file"),
        ({"smpl": Path("none.npz")}, "no such file"),
    ],
)
def test_inputs_that_are_not_there_or_alone_leave_nothing(runs, config, changes, said):
    with pytest.raises(DsnetError, match=said):
        main(dataclasses.replace(config, **changes))
    assert not runs.exists()


@pytest.mark.parametrize("aligner", ["sgd", "robust"])
@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda mesh: np.nan * mesh, "frame 37"),
        (lambda mesh: 1000 * mesh, r"50004_hips in frame 37 measures .* millimetres"),
        (
            lambda mesh: mesh[np.random.default_rng(0).permutation(6890)],
            r"50004_hips, whose frame 37 stays \d+ cm from SMPL",
        ),
    ],
)
def test_a_frame_that_is_no_body_is_named_wherever_it_is(
    runs, config, body, tmp_path, aligner, spoil, message
):
    frames = np.repeat(body.v_template[None], 40, axis=0)
    frames[37] = spoil(frames[37])
    path = tmp_path / "spoilt.h5"
    with write_dyna(path, body.faces) as add:
        add("50004_hips", frames)
    few = RobustSettings(vertices=300, steps=3, calibration_frames=8, calibration_rounds=2)
    odd = dataclasses.replace(config, dyna=(path,), aligner=aligner, robust=few)
    with pytest.raises(DsnetError, match=message) as caught:
        main(odd)
    assert "\n" not in str(caught.value)
    assert list((runs / "t").iterdir()) == []


def both(config):
    few = RobustSettings(vertices=300, steps=3, calibration_frames=16, calibration_rounds=3)
    return dataclasses.replace(config, aligner="both", robust=few)


@pytest.fixture
def of_both(config):
    return both(config)


@pytest.fixture(scope="module")
def runs_of_both(corpus, tmp_path_factory):
    """Runs in which both have aligned."""
    runs = tmp_path_factory.mktemp("both")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DSNET_RUNS", str(runs))
        main(both(config_of(corpus)))
    return runs


@pytest.fixture
def finished(runs, runs_of_both):
    """A copy of them."""
    shutil.copytree(runs_of_both, runs)


@pytest.mark.usefixtures("finished")
def test_both_aligners_of_the_same_meshes(config, of_both, expected):
    run = Run("t")
    paper, robust = run.artifact("align"), run.artifact("align_robust")
    assert [one.manifest["config"]["aligner"] for one in (paper, robust)] == ["sgd", "robust"]
    assert sequences_of(paper) == sequences_of(robust)
    assert paper.manifest["upstream"] == robust.manifest["upstream"]
    assert not (expected[0].path.parent / "align_robust").exists()
    assert expected[0].content_sha256 == paper.content_sha256
    main(dataclasses.replace(of_both, run="robust", aligner="robust"))
    assert not Run("robust").finished("align_robust")
    in_its_place = Run("robust").artifact("align")
    np.testing.assert_array_equal(in_its_place.array("theta"), robust.array("theta"))


@pytest.mark.usefixtures("finished")
def test_each_aligners_options_concern_its_own_artifact(of_both, monkeypatch):
    made = []
    for fit in (SgdFit, RobustFit):
        write = fit.write

        def noted(self, writer, write=write):
            made.append(type(self).__name__)
            write(self, writer)

        monkeypatch.setattr(fit, "write", noted)
    main(of_both)
    assert made == []
    main(dataclasses.replace(of_both, steps=5))
    assert made == ["SgdFit"]
    main(dataclasses.replace(of_both, steps=5, robust=RobustSettings.fast()))
    assert made == ["SgdFit", "RobustFit"]
    main(dataclasses.replace(of_both, steps=5, aligner="sgd"))
    assert made == ["SgdFit", "RobustFit"]


def test_what_the_first_has_finished_is_not_done_again(runs, of_both, monkeypatch):
    with monkeypatch.context() as broken:
        broken.setattr(RobustFit, "write", interrupt)
        with pytest.raises(KeyboardInterrupt):
            main(of_both)
    assert Run("t").finished("align")
    assert not Run("t").finished("align_robust")
    monkeypatch.setattr(SgdFit, "write", lambda *_: pytest.fail("aligned again"))
    main(of_both)
    assert Run("t").finished("align_robust")


def interrupt(*_):
    raise KeyboardInterrupt


def test_best_alignment_is_the_robust_aligners(runs, runs_of_both):
    def refused():
        with pytest.raises(DsnetError, match=r"`dsnet align --aligner both --run t`"):
            best_alignment(Run("t"))

    refused()
    shutil.copytree(runs_of_both / "t" / "align", runs / "t" / "align")
    refused()
    shutil.copytree(runs_of_both / "t" / "align_robust", runs / "t" / "align_robust")
    assert best_alignment(Run("t")).path.name == "align_robust"
    shutil.copytree(runs_of_both / "t" / "align_robust", runs / "u" / "align")
    assert best_alignment(Run("u")).path.name == "align"


def test_a_newer_corpus_asks_for_one_command(runs, of_both, tmp_path):
    body_model = tmp_path / "body.npz"
    shutil.copy(of_both.smpl, body_model)
    main(dataclasses.replace(of_both, smpl=body_model))
    load_body_model("embedded:male").save_smpl_npz(body_model)
    with pytest.raises(
        DsnetError, match=r"stages align, align_robust are older .*Run `dsnet align --run t` again"
    ):
        check(CheckConfig("t"))
