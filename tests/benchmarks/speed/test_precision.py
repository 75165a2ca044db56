"""Codes in both precisions, on a mesh of 40 vertices."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from benchmarks.speed.precision import PRECISIONS, PrecisionConfig, main
from benchmarks.subspaces.codes import CODES
from bridge.runs import Run
from tests.benchmarks.test_subspaces import SMALL, leave_run


@pytest.fixture
def bench(tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    monkeypatch.setattr("benchmarks.speed.precision.LATENT_SIZE", 6)
    for name, code in CODES.items():
        monkeypatch.setitem(CODES, name, replace(code, widths=SMALL.get(code.kind, code.widths)))
    leave_run(name="align")
    return Run("r").path / "bench"


def test_both_precisions_stand_side_by_side_and_other_codes_are_kept(bench):
    config = PrecisionConfig(run="r", codes=("mesh_measured",), steps=4, rounds=2)
    main(config)
    first = json.loads((bench / "precision.json").read_text())
    main(replace(config, codes=("casas_otaduy",)))
    found = json.loads((bench / "precision.json").read_text())
    assert list(found["codes"]) == ["mesh_measured", "casas_otaduy"]
    assert found["codes"]["mesh_measured"] == first["codes"]["mesh_measured"]
    for code in found["codes"].values():
        assert [len(code["step_cpu_s"][name]) for name in PRECISIONS] == [2, 2]
        exact, rounded = (code["r2"][name] for name in PRECISIONS)
        assert exact != rounded
        for frames in ("validation", "held_out"):
            assert code["r2_change"][frames] == rounded[frames] - exact[frames]
            assert rounded[frames] == pytest.approx(exact[frames], abs=0.05)
    assert not list(bench.glob("*.safetensors*"))
