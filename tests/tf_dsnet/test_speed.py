"""The benchmark runs and writes what it says."""

from __future__ import annotations

import json

from benchmarks.speed import dsnet


def test_results_are_written(runs, monkeypatch):
    monkeypatch.setattr(dsnet, "SEQUENCES", 3)
    monkeypatch.setattr(dsnet, "FRAMES", 5)
    dsnet.main(dsnet.KerasBenchConfig(run="tiny", epochs=1, steps=2))
    results = json.loads((runs / "tiny" / "bench" / "tensorflow.json").read_text())
    assert results["epoch_s"] > 0
    assert results["epoch_keras_lstm_s"] > 0
    assert results["step_us"].keys() == {"1", "16"}
    assert [path.name for path in (runs / "tiny" / "bench").iterdir()] == ["tensorflow.json"]
