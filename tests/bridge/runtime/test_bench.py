"""The runtime's benchmark: every part and whole, with its limits, in a file."""

from __future__ import annotations

import json

import pytest

from bridge.runtime import bench
from bridge.runtime.bench import RuntimeBenchConfig, main
from bridge.verify.draws import SMALL_WIDTHS

PARTS = ("load", "step", "spread", "decoder", "skinning")
WHOLE = ("dsnet_plus", "dsnet_plus_int8", "dsnet", "dsnet_int8")


@pytest.mark.parametrize("clock", ["wall", "processor"])
def test_every_part_has_its_ratios(tmp_path, monkeypatch, clock):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    widths = (6890, *SMALL_WIDTHS[1:])
    monkeypatch.setattr(bench, "INFERRED_WIDTHS", widths)
    monkeypatch.setattr(bench, "_ARCHITECTURE", {**bench._ARCHITECTURE, "widths": widths})
    monkeypatch.setattr(bench, "_SQUARE", 64)
    main(RuntimeBenchConfig(run="r", rounds=1, characters=(2,), nodes=30, clock=clock))
    results = json.loads((tmp_path / "r" / "bench" / "runtime.json").read_text())
    assert results["clock"] == clock
    found = results["characters_2"]
    assert set(found["frames_per_s"]) == set(WHOLE)
    for name in (*PARTS, *WHOLE):
        assert list(found[name]) == ["times_reading_weights", "times_multiplying", "ms"]
        assert min(found[name].values()) > 0


def test_multiplications_are_those_of_the_papers_sizes():
    counts = bench._multiplications(500)
    # Each of the four convolutions' weights once a feature, and the linear layer to 270 numbers.
    mixing = 6890 * 2000 + 2000 * 1300 + 1300 * 300 + 300 * 30
    assert counts["decoder"] == 9 * mixing + 270 * 100
    assert counts["dsnet"] > counts["decoder"] > 10 * counts["skinning"]
