"""Recorded motions summed up, and errors by frequency: the committed pages are their numbers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.prediction import bands, recordings
from bridge.errors import DsnetError
from bridge.motion import MotionSequence

DOCS = Path(__file__).parents[3] / "docs" / "results" / "prediction"


def _clip(name: str, cell: str, r2: float) -> dict:
    plus = {"offsets": {"r2": r2, "rms_mm": 1.0}, "velocity": {"r2": r2 / 2}}
    smpl = {"offsets": {"r2": 0.0, "rms_mm": 3.0}}
    return {"name": name, "cell": cell, "frames": 60, "errors": {"dsnet_plus": plus, "smpl": smpl}}


def _folder(path: Path, *clips: dict) -> Path:
    path.mkdir()
    score = {"corpus": "own", "seed": 0, "sequences": clips}
    (path / "own-0.json").write_text(json.dumps(score))
    (path / "test_bed.json").write_text(json.dumps({"command": "x", "scores": ["own-0.json"]}))
    return path


def test_clips_of_real_motions_are_summed_up_for_known_and_new_people(tmp_path):
    known, new = "known_person_unseen_motion", "new_person_unseen_motion"
    folder = _folder(
        tmp_path / "cmu",
        *(_clip(f"50004_bvh_{n}", known, r2) for n, r2 in enumerate((0.9, 0.5, 0.86))),
        _clip("50004_dancing", known, -9.0),
        _clip("99001_amass_x", new, 0.4),
    )
    text = recordings.markdown(tmp_path / "page.md", [folder], "the command")
    rows = [line for line in text.splitlines() if line.startswith("| cmu")]
    assert rows == [
        "| cmu | own | known person | 3 | 3.00 | 0.860 | 0.500 | `50004_bvh_1` | 2 | 0.430 |",
        "| cmu | own | new person | 1 | 3.00 | 0.400 | 0.400 | `99001_amass_x` | 0 | 0.200 |",
    ]
    assert "by frequency" not in text
    invented = _folder(tmp_path / "none", _clip("50004_dancing", known, 0.9))
    with pytest.raises(DsnetError, match="of whose motions none is real"):
        recordings.markdown(tmp_path / "page.md", [invented], "")


def test_the_committed_page_is_made_of_the_committed_scores():
    page = DOCS / "recordings.md"
    command = page.read_text().partition("Made by `")[2].partition("`")[0]
    folders = [DOCS.parents[2] / one for one in command.partition("--folders ")[2].split()]
    assert len(folders) == 5
    text = recordings.markdown(page, folders, command)
    assert page.read_text() == text
    for section in ("frequency, law `own`", "frequency, law `second`", "accelerations read twice"):
        assert f"{section}\n\n| " in text


def test_energies_stand_in_their_bands():
    """A swing of 5 Hz, which the prediction has, and one of 14 Hz, which it has twice as large."""
    time_s = np.arange(240) / 60
    slow, fast = (np.sin(2 * np.pi * hz * time_s)[:, None, None] for hz in (5.0, 14.0))
    ones = np.ones((1, 4, 3))
    whole = MotionSequence("50004_x", "50004", "x", 0, 240, 60.0, "test")
    found = bands.band_energies((slow + fast + 1) * ones, (slow + 2 * fast) * ones, whole)
    truth, error, predicted = found / found[0].sum()
    where = [bands.EDGES_HZ.index(4), bands.EDGES_HZ.index(12)]
    np.testing.assert_allclose(truth[where], 0.5, rtol=1e-2)
    np.testing.assert_allclose(error[where], [0, 0.5], atol=1e-2)
    np.testing.assert_allclose(predicted[where], [0.5, 2], rtol=1e-2)
    assert np.delete(found[0], where).max() < 1e-3 * found[0].sum()
