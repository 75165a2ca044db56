"""`--body`: the packaged flesh, or a run's, on a body model of the user's own."""

from __future__ import annotations

import base64
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.other_bodies import renumbered
from bridge import DsnetError
from bridge.body import BodyModelData, load_body_model
from bridge.motion import load_motion
from bridge.runs import Run, read_artifact
from dsnet.cli import main
from dsnet.prediction.controls import Controls, controlled_body
from dsnet.prediction.load_model import TrainedModel, find_model, load_model
from dsnet.prediction.moving_body import MovingBody
from dsnet.prediction.shape_space import with_betas_on
from dsnet.stream.streams import Stream
from dsnet.view.clip_list import open_clip_list
from dsnet.view.scene import Scene
from tests.forged.amass import save, smplh
from tests.forged.bodies import person
from tests.forged.other_bodies import with_pelvis_off

HOME = load_body_model("embedded:female")
SAMPLE = "sample:walking"
FILE = np.linspace(-1, 1, 10)
"""Betas of a file."""


def of_others(body: BodyModelData) -> BodyModelData:
    """As a file that does not say `synthetic`, like all that people download."""
    return replace(body, source="licensed")


@pytest.fixture(scope="module")
def body_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Another order of vertices, the pelvis off the origin."""
    path = tmp_path_factory.mktemp("bodies") / "SMPL_FEMALE.npz"
    of_others(renumbered(with_pelvis_off(HOME))[0]).save_smpl_npz(path)
    return path


def walk(frames: int, path: Path, **changes: object) -> Path:
    return save(path, smplh(frames, 60.0), gender="female", **changes)


@pytest.mark.usefixtures("blank_strip")
def test_predict_writes_that_bodys_skin(body_file, tmp_path, capsys):
    motion = walk(70, tmp_path / "in" / "a.npz", trans=_hops(70))
    said = {}
    for name, options in {"own": (), "other": ("--body", str(body_file))}.items():
        options = (*options, "--betas", "1,-1,0.5,0,0,0,0,0,0,0")
        main(["predict", "--motion", str(motion), "--out", str(tmp_path / name), *options])
        said[name] = capsys.readouterr().err
    own, other = (read_artifact(tmp_path / name) for name in ("own", "other"))
    _, order = renumbered(HOME)
    offsets_m = own.array("offsets")[:, order]
    assert np.abs(offsets_m).max() > 0.002
    np.testing.assert_allclose(other.array("offsets"), offsets_m, atol=1e-6)
    apart_m = other.array("vertices") - own.array("vertices")[:, order]
    assert np.ptp(apart_m, axis=(0, 1)).max() < 1e-4  # where its pelvis is, and no more
    assert other.manifest["body_model"] == "SMPL_FEMALE.npz"
    assert "no --run given, on SMPL_FEMALE.npz" in said["other"]
    assert str(body_file.parent) not in json.dumps(other.manifest["controls"])


def _hops(frames: int) -> np.ndarray:
    trans = np.zeros((frames, 3))
    trans[:, 2] = 0.9 + 0.1 * np.abs(np.sin(np.arange(frames) / 6))
    return trans


def test_the_environment_says_it_for_always(body_file, monkeypatch):
    monkeypatch.setenv("DSNET_BODY", str(body_file))
    bodies = Stream()
    assert load_model(None).body.name == HOME.name  # who asks for the package's model gets it
    who = bodies.join(np.zeros(10))
    moved = bodies.step({who: np.zeros(69)})[who]
    _, order = renumbered(HOME)
    rest_m = with_pelvis_off(HOME).v_template[order]
    np.testing.assert_allclose(moved.vertices_m - moved.offsets_m, rest_m, atol=1e-5)


def test_a_stream_moves_a_mans_body_as_a_mans():
    bodies = Stream(body=load_body_model("embedded:male"))
    who = bodies.join(np.zeros(10))
    found = [bodies.step({who: pose})[who] for pose in np.linspace(np.zeros(69), 0.2, 9)]
    of_men = Stream(gender="male")
    who = of_men.join(np.zeros(10))
    for moved, pose in zip(found, np.linspace(np.zeros(69), 0.2, 9), strict=True):
        np.testing.assert_array_equal(moved.offsets_m, of_men.step({who: pose})[who].offsets_m)
    with pytest.raises(DsnetError, match="gender='Male'; expected female or male"):
        Stream(gender="Male")


def test_a_streamed_file_is_what_is_predicted_of_it(body_file, tmp_path, capsys):
    """Where her root is, her shape, and what is told of it."""
    path = walk(20, tmp_path / "a.npz", betas=np.linspace(1, -1, 16), trans=_hops(20))
    trained, motion = Controls(body=body_file).load(None, None, path)
    moving = controlled_body(trained, motion, Controls(body=body_file))
    expected_m = np.concatenate([posed.vertices_m for posed in moving])
    said = capsys.readouterr().err
    bodies = Stream(body=body_file)
    placed = bodies.placed(load_motion(path))
    assert capsys.readouterr().err in said
    who = bodies.join(placed.betas)
    found = [bodies.step({who: theta})[who] for theta in placed.theta]
    found = [*found[bodies.latency_frames :], *bodies.leave(who)]
    np.testing.assert_allclose([body.vertices_m for body in found], expected_m, atol=1e-5)


def test_a_stream_takes_as_many_betas_as_a_body_file_has(tmp_path):
    person("smplh", shapes=16).save_smpl_npz(tmp_path / "SMPLH_FEMALE.npz")
    for asked in (tmp_path / "SMPLH_FEMALE.npz", load_body_model(tmp_path / "SMPLH_FEMALE.npz")):
        bodies = Stream(body=asked)
        for count in (10, 13, 16):
            bodies.join(np.zeros(count))
        with pytest.raises(DsnetError, match=r"shape \(17,\); expected \(10,\) to \(16,\)"):
            bodies.join(np.zeros(17))


def test_the_papers_networks_are_bound_to_their_body(trained_run, body_file):
    with pytest.raises(
        DsnetError, match=r"dsnet_standardised of run 'r' with the body .*dsnet_plus"
    ):
        load_model(trained_run, body=str(body_file))


def test_men_are_moved_where_the_body_is_a_mans():
    found = load_model(None, gender="female", body="embedded:male")
    assert (found.body_model, found.trained_on, found.other_body) == (
        "embedded:male",
        "embedded:male",
        None,
    )


def test_a_neutral_motion_is_told_whose_body_it_gets(capsys):
    find_model(None, gender="neutral")
    assert "embedded:female: --gender male or --body" in capsys.readouterr().err


def test_a_motion_without_gender_moves_a_woman_and_says_how_to_move_a_man(tmp_path, capsys):
    path = walk(5, tmp_path / "a.npz")
    for gender, controls in (
        ("unknown", Controls()),
        ("unknown", Controls(gender="female")),
        ("female", Controls()),
    ):
        with np.load(path) as stored:
            np.savez(path, **{**stored, "gender": gender})
        moving = controlled_body(*controls.load(None, None, path), controls)
        moving.announce()
        assert moving.body.name == "embedded:female"
        is_told = "the motion names no gender: --gender male" in capsys.readouterr().err
        assert is_told == (gender == "unknown" and controls.gender is None)


def test_a_predictor_alone_has_no_motion_without_a_gender(tmp_path, capsys):
    main(["export", "--to", "onnx", "--out", str(tmp_path / "body.onnx")])
    assert "names no gender" not in capsys.readouterr().err


def test_a_gender_is_asked_for_where_the_file_says_another(body_file, tmp_path, capsys):
    """The body is of it, the betas are still those of the file's."""
    path = walk(5, tmp_path / "a.npz")
    with np.load(path) as stored:
        np.savez(path, **{**stored, "gender": "neutral", "betas": FILE})
    trained, motion = Controls(gender="male").load(None, None, path)
    assert (trained.body.name, motion.gender) == ("embedded:male", "neutral")
    assert not capsys.readouterr().err
    (tmp_path / "bodies").mkdir()
    for body in (of_others(load_body_model("embedded:male")), load_body_model(body_file)):
        body.save_smpl_npz(tmp_path / "bodies" / f"SMPL_{body.gender.upper()}.npz")
    trained, motion = Controls(gender="male", body=tmp_path / "bodies").load(None, None, path)
    assert trained.body.gender == "male"
    with_betas_on(motion, trained.body)
    assert "are a neutral body's, the body is male" in capsys.readouterr().err


@pytest.mark.parametrize("body", [None, Path("embedded:female")])
def test_a_gender_that_the_body_is_not_of_is_refused(plus_run, body):
    asked = Controls(gender="male", body=body)
    said = "--gender male with embedded:female for dsnet_plus of .*; expected a female body's"
    with pytest.raises(DsnetError, match=said):
        asked.load(plus_run, None, Path(SAMPLE))
    with pytest.raises(DsnetError, match=said):
        open_clip_list(plus_run, None, asked)


def test_a_page_has_nothing_of_a_body_of_others(body_file):
    """Places alone: neither template, shapes, weights nor the graph, which holds them all."""
    scene = Scene(open_clip_list(None, Path(SAMPLE), Controls(body=body_file)))
    assert scene.baked
    assert not {"model", "shapes"} & set(scene.assets)
    facts = json.loads(scene.assets["scene"]())
    assert "licence" in facts["baked"]
    assert not {"root_joint", "root_joint_shapes", "graph"} & set(facts)
    assert set(base64.b64decode(facts["bone_of"])) == {0}


def test_an_exported_page_is_baked_too(body_file, tmp_path):
    main([
        "export", "--to", "html", "--motion", "sample:walk_cycle", "--body", str(body_file),
        "--out", str(tmp_path / "a.html"),
    ])  # fmt: skip
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert 'id="asset:track0_smpl"' in page
    assert 'id="asset:model"' not in page


MAN = load_body_model("embedded:male")
OF_SMPL, NO_GENDER = of_others(HOME), replace(of_others(HOME), gender="unknown")
IN_DOUBT = "does not say whose betas it has: taken as the body's; --shape"


@pytest.mark.parametrize(
    ("body", "file", "used", "said"),
    [
        (OF_SMPL, {}, True, ""),
        (HOME, {"source": "synthetic"}, True, ""),
        (HOME, {"body_model": "embedded:female"}, True, ""),
        (NO_GENDER, {}, True, "does not say its gender: it takes a female body's betas"),
        (OF_SMPL, {"gender": None}, True, IN_DOUBT),
        (OF_SMPL, {"poses": np.zeros((5, 66))}, True, IN_DOUBT),
        (HOME, {}, False, "another body model's"),
        (OF_SMPL, {"gender": "male"}, False, "are a male body's, the body is female"),
        (OF_SMPL, {"gender": "neutral"}, False, "are a neutral body's, the body is female"),
        (of_others(MAN), {}, False, "are a female body's, the body is male"),
        (MAN, {"source": "synthetic"}, False, "are a female body's, the body is male"),
    ],
)
def test_betas_are_used_on_bodies_that_they_are_of(tmp_path, capsys, body, file, used, said):
    """Told wherever that is in doubt; an embedded body takes this project's alone."""
    path = save(tmp_path / "a.npz", smplh(5), **{"betas": FILE, "gender": "female", **file})
    found = with_betas_on(load_motion(path), body).betas
    np.testing.assert_array_equal(found, FILE if used else np.zeros(10))
    printed = capsys.readouterr().err
    assert said in printed
    assert printed.count("\n") == bool(said)


def test_betas_of_another_kind_or_beyond_the_bodys_are_left_out(tmp_path, capsys):
    motion = load_motion(walk(5, tmp_path / "a.npz", betas=np.linspace(-1, 1, 16)))
    assert with_betas_on(motion, OF_SMPL).betas.shape == (10,)
    assert "6 of 16 betas are left out" in capsys.readouterr().err
    assert not with_betas_on(replace(motion, kind="smplx"), OF_SMPL).betas.any()
    assert "are SMPL-X's, the body SMPL's" in capsys.readouterr().err


def test_a_doubt_is_not_told_where_nothing_depends_on_it(tmp_path, capsys):
    motion = load_motion(walk(5, tmp_path / "a.npz", betas=FILE, poses=np.zeros((5, 66))))
    with_betas_on(motion, OF_SMPL, warn=False)
    with_betas_on(replace(motion, betas=np.zeros(10)), OF_SMPL)
    with_betas_on(replace(motion, embedded_betas=True), HOME)
    assert not capsys.readouterr().err


def test_a_runs_own_model_is_carried_over_too(plus_run: Run, body_file):
    trained, motion = Controls(body=body_file).load(plus_run, None, Path(SAMPLE))
    assert isinstance(trained, TrainedModel)
    own, _ = Controls().load(plus_run, None, Path(SAMPLE))
    _, order = renumbered(HOME)
    short = replace(motion, theta=motion.theta[:40])
    found, expected = (
        np.concatenate([part.offsets_m for part in MovingBody(one, short)])
        for one in (trained, own)
    )
    np.testing.assert_allclose(found, expected[:, order], atol=1e-6)
