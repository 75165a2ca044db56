"""The runtime's benchmark: every part and whole, with its limits, in a file."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks.speed import graphs, limits
from benchmarks.speed.limits import GraphCall, operations_bytes
from benchmarks.speed.runtime import RuntimeBenchConfig, main
from dsnet.verify.draws import SMALL_WIDTHS

PARTS = ("load", "step", "spread", "decoder", "skinning")
WHOLE = ("dsnet_plus", "dsnet_plus_int8", "dsnet", "dsnet_int8")
MEASURED = ["times_moving", "times_multiplying", "ms", "must_move_mb", "operations_move_mb"]


@pytest.mark.parametrize("clock", ["wall", "processor"])
def test_every_part_has_its_ratios(tmp_path, monkeypatch, clock):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    widths = (6890, *SMALL_WIDTHS[1:])
    monkeypatch.setattr(graphs, "INFERRED_WIDTHS", widths)
    monkeypatch.setattr(graphs, "ARCHITECTURE", {**graphs.ARCHITECTURE, "widths": widths})
    monkeypatch.setattr(limits, "_SQUARE", 64)
    main(RuntimeBenchConfig(run="r", rounds=1, characters=(2,), nodes=30, clock=clock))
    results = json.loads((tmp_path / "r" / "bench" / "runtime.json").read_text())
    assert results["clock"] == clock
    found = results["characters_2"]
    assert set(found["frames_per_s"]) == set(WHOLE)
    for name in (*PARTS, *WHOLE):
        assert list(found[name]) == MEASURED
        assert min(found[name].values()) > 0
        assert found[name]["operations_move_mb"] > found[name]["must_move_mb"]


def test_multiplications_are_those_of_the_papers_sizes():
    counts = graphs.multiplications(500)
    # Each of the four convolutions' weights once a feature, and the linear layer to 270 numbers.
    mixing = 6890 * 2000 + 2000 * 1300 + 1300 * 300 + 300 * 30
    assert counts["decoder"] == 9 * mixing + 270 * 100
    assert counts["dsnet"] > counts["decoder"] > 10 * counts["skinning"]


def test_bytes_of_a_product_and_a_sum_are_those_of_their_arrays():
    kernel = np.ones((30, 40), np.float32)
    model = graphs.graph_of(
        lambda g: g.apply("Tanh", g.input("x", ("B", 30)) @ g.array("kernel", kernel))
    )
    rng = np.random.default_rng(0)
    given, product = 7 * 30, 7 * 40
    assert GraphCall(model, rng, 7, 1).given_and_found_bytes() == 4 * (given + product)
    assert operations_bytes(model, rng, 7) == 4 * (given + 3 * product)
