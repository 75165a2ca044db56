"""Recorded motions summed up: the committed page is its numbers."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.prediction import recordings
from bridge.errors import DsnetError

PAGE = Path(__file__).parents[3] / "docs" / "results" / "prediction" / "recordings.md"


def _clip(motion: str, who: str, r2: float) -> dict:
    return {
        "motion": motion,
        "who": who,
        "smoothed": "auto",
        "true_mm": 3.0,
        "r2": r2,
        "settled_r2": r2 + 0.02,
        "velocity_r2": r2 / 2,
        "fast_share": 0.1,
        "slow_r2": r2 + 0.01,
    }


def test_clips_are_summed_up_for_known_and_new_people(tmp_path):
    clips = [_clip(f"{n}.bvh", "known person", r2) for n, r2 in enumerate((0.9, 0.5, 0.86))]
    clips.append(_clip("x.bvh", "new person", 0.4))
    clips += [{**clip, "smoothed": "as recorded", "r2": -1.0} for clip in clips]
    path = tmp_path / "recordings.json"
    path.write_text(json.dumps({"runs": {"bed_own": clips}, "command": "the command"}))
    rows = [line for line in recordings.markdown(path).splitlines() if "| auto |" in line]
    assert rows == [
        "| `bed_own` | auto | known person | 3 | 3.00 | 0.860 | 0.500 | `1.bvh` | 2 | 0.880"
        " | 0.430 | 10 % | 0.870 |",
        "| `bed_own` | auto | new person | 1 | 3.00 | 0.400 | 0.400 | `x.bvh` | 0 | 0.420"
        " | 0.200 | 10 % | 0.410 |",
    ]


def test_motions_that_are_missing_are_one_line(tmp_path):
    config = recordings.RecordingsConfig(tmp_path / "page.md", tmp_path)
    with pytest.raises(DsnetError, match=r"without bandai_walk\.bvh, "):
        recordings.main(config)
    assert not config.out.exists()


def test_the_committed_page_is_made_of_its_numbers():
    assert PAGE.read_text() == recordings.markdown(PAGE.with_suffix(".json"))
