"""Damaged files of every kind are accepted or refused, by every reader; nothing else happens.

A longer campaign, and one by coverage: `python -m tests.fuzz.campaign --help`.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

from tests.fuzz.campaign import try_reader
from tests.fuzz.readers import READERS

pytestmark = pytest.mark.fuzz
_INPUTS = {"smpl_npz": 60, "smpl_pickle": 60}


@pytest.mark.parametrize("name", READERS)
def test_damaged_files_are_accepted_or_refused(name: str, tmp_path: Path) -> None:
    counts = try_reader(name, _INPUTS.get(name, 300), 0, tmp_path / name)
    assert counts["others"] == []
    assert counts["refused"] > 0
    assert counts["max_rss_mb"] <= 1024


@pytest.mark.skipif(not importlib.util.find_spec("atheris"), reason="atheris is not installed")
@pytest.mark.parametrize("name", ["amass", "artifact", "weights", "smpl_pickle"])
def test_so_are_those_that_take_new_branches(name: str, tmp_path: Path) -> None:
    counts = try_reader(name, 100, 0, tmp_path / name, guided=True)
    assert counts["others"] == []
