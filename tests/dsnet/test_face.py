"""`import dsnet`: what it offers, from a motion to arrays in three lines, and models as folders."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import dsnet
from bridge.body import load_body_model
from bridge.runs import Run, read_artifact
from dsnet.prediction.load_model import load_model


def test_a_motion_becomes_arrays(motion: Path) -> None:
    vertices_m, offsets_m = dsnet.animate(dsnet.load_motion(motion)).arrays()
    assert vertices_m.shape == offsets_m.shape == (31, 6890, 3)
    pieces = [moved.vertices_m for moved in dsnet.animate(motion)]
    np.testing.assert_array_equal(np.concatenate(pieces), vertices_m)


def test_files_hold_the_same(motion: Path, tmp_path: Path, blank_strip: None) -> None:
    out = dsnet.predict(motion, tmp_path / "out", "female", gain=2.0)
    _, offsets_m = dsnet.animate(motion, gain=2.0).arrays()
    np.testing.assert_array_equal(np.load(out / "offsets.npy"), offsets_m)
    assert read_artifact(out).manifest["controls"] == {"gain": 2.0}


def test_everything_offered_is_there() -> None:
    assert len(dsnet.__all__) <= 13
    assert all(getattr(dsnet, name) is not None for name in dsnet.__all__)
    assert dir(dsnet) == sorted(dsnet.__all__)


def test_a_model_is_given_away_as_a_folder(plus_run: Run, motion: Path, tmp_path: Path) -> None:
    trained = dsnet.load_model(plus_run.name)
    folder = trained.save(tmp_path / "model").path
    assert sorted(path.name for path in folder.iterdir()) == [
        "dsnet_plus.safetensors",
        "manifest.json",
    ]
    given, own = dsnet.load_model(folder), dsnet.load_model(trained)
    assert given.origin == "synthetic"
    for one, other in zip(
        dsnet.animate(motion, given).arrays(), dsnet.animate(motion, own).arrays(), strict=True
    ):
        np.testing.assert_array_equal(one, other)
    again = given.save(tmp_path / "again").path  # what was given can be given on
    _, offsets_m = dsnet.animate(motion, again).arrays()
    np.testing.assert_array_equal(offsets_m, dsnet.animate(motion, own).arrays()[1])


def test_so_is_the_papers_network(trained_run: Run, motion: Path, tmp_path: Path) -> None:
    folder = dsnet.load_model(trained_run.name, "dsnet_faithful").save(tmp_path / "model").path
    _, expected_m = dsnet.animate(motion, trained_run.name, predictor="dsnet_faithful").arrays()
    _, found_m = dsnet.animate(motion, folder).arrays()
    np.testing.assert_array_equal(found_m, expected_m)
    with pytest.raises(dsnet.DsnetError, match="dsnet_faithful"):
        dsnet.load_model(folder, "dsnet_standardised")


def test_a_licensed_body_is_not_given_away(
    plus_run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The folder holds its digest; who opens it passes the file, and no other."""
    mine, other = tmp_path / "SMPL.npz", tmp_path / "OTHER.npz"
    load_body_model("embedded:female").save_smpl_npz(mine)
    load_body_model("embedded:male").save_smpl_npz(other)
    monkeypatch.setattr("dsnet.prediction.load_model.body_model_path", lambda run: mine)
    folder = load_model(plus_run).save(tmp_path / "model").path
    assert str(tmp_path) not in (folder / "manifest.json").read_text().split('"provenance"')[0]
    assert dsnet.load_model(folder, body=mine).body_model == str(mine)
    for body in (None, other):
        with pytest.raises(dsnet.DsnetError, match="licensed body that it was trained on"):
            dsnet.load_model(folder, body=body)


def test_a_damaged_folder_is_refused(plus_run: Run, tmp_path: Path) -> None:
    folder = dsnet.load_model(plus_run.name).save(tmp_path / "model").path
    manifest = json.loads((folder / "manifest.json").read_text())
    (folder / "manifest.json").write_text(json.dumps(manifest | {"stages": ["os.system"]}))
    with pytest.raises(dsnet.DsnetError):
        dsnet.load_model(folder)


def test_a_run_goes_before_a_folder_of_its_name(
    plus_run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dsnet.load_model().save(tmp_path / plus_run.name)
    monkeypatch.chdir(tmp_path)
    assert dsnet.load_model(plus_run.name).owner == "run 'r'"


@pytest.mark.parametrize(
    ("controls", "words"),
    [
        ({"floor": "shfit"}, "shift"),
        ({"floor": True}, "shift"),
        ({"pose": "bonny"}, "bony"),
        ({"up": "x"}, "auto"),
        ({"smooth_hz": "atuo"}, "auto"),
        ({"gain": "2"}, "a number"),
        ({"gain": -1.0}, "0 to 20"),
        ({"gain": float("inf")}, "--gain inf"),
        ({"gian": 2.0}, "gain"),
        ({"shape": "hevy"}, "heavy"),
        ({"shape": 182}, "height"),
        ({"shape": {"heigt": 182}}, "height"),
        ({"betas": [1, 2]}, "ten|10"),
    ],
)
def test_wrong_controls_are_one_line(controls, words):
    with pytest.raises(dsnet.DsnetError, match=words) as caught:
        dsnet.animate("sample:jumping_jacks", **controls)
    assert "\n" not in str(caught.value)


def test_numbers_and_words_say_the_same():
    by_words = dsnet.Controls(
        shape=("height=182",), part_gain=("belly=2",), betas="1,0,0,0,0,0,0,0,0,0"
    )
    betas = np.eye(10)[0]
    given = {"shape": {"height": 182}, "part_gain": {"belly": 2}, "betas": betas}
    by_numbers = dsnet.Controls.of(given)
    assert (by_numbers.shape, by_numbers.part_gain) == (by_words.shape, by_words.part_gain)
    assert [*map(float, str(by_numbers.betas).split(","))] == betas.tolist()
