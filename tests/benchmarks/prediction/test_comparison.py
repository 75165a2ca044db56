"""The published scores make the published pages, and scores of other data do not join them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.prediction import ablation, comparison, test_bed
from benchmarks.prediction.comparison_scores import joined, refuse_mixture
from bridge.errors import DsnetError

RESULTS = Path(__file__).parents[3] / "docs" / "results"


def test_the_committed_pages_are_made_of_the_committed_scores():
    folder = RESULTS / "comparison"
    refuse_mixture(folder)
    assert comparison.page_path(folder).read_text() == comparison.markdown(folder)
    bed = RESULTS / "prediction"
    assert (bed / "test_bed.md").read_text() == test_bed.markdown(bed)
    parts = json.loads((bed / "ablation" / "ablation.json").read_text())
    assert (bed / "ablation" / "ablation.md").read_text() == ablation.markdown(parts)


def test_scores_of_other_data_are_refused(tmp_path):
    text = (RESULTS / "comparison" / "own-0.json").read_text()
    kept, other = json.loads(text), json.loads(text)
    (tmp_path / "own-0.json").write_text(text)
    (tmp_path / "own-1.json").write_text(json.dumps({**other, "epochs": 20}))
    with pytest.raises(DsnetError, match=r"own-1\.json with other epochs than own-0\.json"):
        refuse_mixture(tmp_path)
    other["sequences"][1]["errors"]["smpl"]["rms_mm"] += 0.01
    with pytest.raises(DsnetError, match=r"other offsets of \S+ than in own-0\.json"):
        joined(kept, other, ["dyna_like"], "own-0.json")
