"""The runtime's benchmark: every part and whole, with its limits, in a file; peers agree first."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks.speed import graphs, limits, peers
from benchmarks.speed.runtime import RuntimeBenchConfig, main
from bridge import DsnetError
from dsnet.verify.draws import SMALL_WIDTHS

PARTS = ("load", "step", "spread", "decoder", "skinning")
WHOLE = ("dsnet_plus", "dsnet_plus_int8", "dsnet", "dsnet_int8")


def test_every_part_has_its_ratios(tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    widths = (6890, *SMALL_WIDTHS[1:])
    monkeypatch.setattr(graphs, "INFERRED_WIDTHS", widths)
    monkeypatch.setattr(graphs, "ARCHITECTURE", {**graphs.ARCHITECTURE, "widths": widths})
    monkeypatch.setattr(limits, "_SQUARE", 64)
    main(RuntimeBenchConfig(run="r", rounds=1, characters=(2,), nodes=30, clock="processor"))
    results = json.loads((tmp_path / "r" / "bench" / "runtime.json").read_text())
    found = results["characters_2"]
    assert set(found["frames_per_s"]) == set(WHOLE)
    for name in (*PARTS, *WHOLE):
        assert min(found[name].values()) > 0
        assert found[name]["operations_move_mb"] > found[name]["must_move_mb"]


def test_what_differs_is_not_compared():
    ones = np.ones((2, 5, 3))
    peers._require_same({"ours": ones, "theirs": ones + 1e-5})
    for other in (ones + 1e-3, ones * np.nan):
        with pytest.raises(DsnetError, match="theirs"):
            peers._require_same({"ours": ones, "theirs": other})
