"""Trainings from other seeds beside a run: which are counted, and their mean and spread."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from bridge.runs import Run, write_artifact
from bridge.runs.artifact import read_artifact
from dsnet.evaluation.evaluation import evaluate_run
from dsnet.report import stage_report
from dsnet.report.results import of_other_seeds, spread_over

SHARED = ("corpus", "truth", "align", "train-ae", "encode")


def copy_run(source: Path, target: Path, offsets_factor: float) -> None:
    """The same run by links, as `reproduce.sh` makes it, whose predictions are larger."""
    target.mkdir()
    for stage in SHARED:
        (target / stage).symlink_to(source / stage)
    for stage in ("train", "infer"):
        shutil.copytree(source / stage, target / stage)
    decoded = read_artifact(source / "decode")
    arrays = {name: np.array(decoded.array(name)) for name in decoded.manifest["arrays"]}
    arrays["offsets_dsnet_small"] *= np.float32(offsets_factor)
    kept = ("sequences", "predictors", "default")
    recorded = {key: decoded.manifest[key] for key in kept}
    units = dict.fromkeys(arrays, "m")
    write_artifact(
        target / "decode", "decode", arrays, units=units, data="synthetic", config={}, **recorded
    )


@pytest.fixture(scope="module")
def runs(forged_runs, tmp_path_factory):
    folder = tmp_path_factory.mktemp("seeds")
    ignored = shutil.ignore_patterns("evaluate", "report")
    shutil.copytree(forged_runs / "forged", folder / "r", ignore=ignored)
    for seed, factor in ((1, 1.1), (10, 0.8)):
        copy_run(folder / "r", folder / f"r-seed{seed}", factor)
    (folder / "r-seed2").mkdir()  # begun, not evaluated
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DSNET_RUNS", str(folder))
        for name in ("r", "r-seed1", "r-seed10"):
            evaluate_run(Run(name))
        patch.setattr(stage_report, "plan_figures", lambda scene: [])
        stage_report.main(stage_report.ReportConfig(run="r"))
    return folder


def test_results_have_mean_and_spread_over_the_runs(runs):
    results = json.loads((runs / "r" / "report" / "results.json").read_text())
    assert results["seeds"]["seeds"] == [0, 1, 10]
    each = [
        read_artifact(runs / name / "evaluate").manifest["cells"]["validation"]["dsnet_small"]
        for name in ("r", "r-seed1", "r-seed10")
    ]
    found = results["seeds"]["cells"]["validation"]["dsnet_small"]
    for reference, number in (("offsets", "r2"), ("mesh", "r2"), ("mesh", "mean_mm")):
        values = [one[reference][number] for one in each]
        assert len(set(values)) == 3
        assert found[reference][number]["mean"] == pytest.approx(np.mean(values))
        assert found[reference][number]["sd"] == pytest.approx(np.std(values, ddof=1))
    other = results["seeds"]["cells"]["validation"]["dsnet_other"]["offsets"]["r2"]
    assert other["sd"] == pytest.approx(0.0, abs=1e-12)
    page = (runs / "r" / "report" / "report.md").read_text()
    assert "trainings from seeds 0, 1, 10 on one alignment" in page
    mesh = found["mesh"]
    shown = f"{mesh['r2']['mean']:.2f} ± {mesh['r2']['sd']:.2f}, {mesh['mean_mm']['mean']:.2f} mm"
    assert f"| {results['predictors']['dsnet_small']} | ✓ {shown} |" in page


def test_a_run_of_another_alignment_is_left_out(runs, monkeypatch, capsys):
    monkeypatch.setenv("DSNET_RUNS", str(runs))
    own = Run("r").artifact("evaluate")
    stray = runs / "r-seed7" / "evaluate"
    upstream = {**own.manifest["upstream"], "align": "0" * 64}
    write_artifact(stray, "evaluate", {}, units={}, data="synthetic", config={}, upstream=upstream)
    assert list(of_other_seeds(Run("r"), own)) == [1, 10]
    assert "left out: run 'r-seed7'" in capsys.readouterr().err


def test_what_a_seed_lacks_has_no_spread():
    cells = [{"a": {"p": {"mesh": {"r2": value}}}} for value in (0.5, 0.7)]
    spread = spread_over(cells, ["p", "q"])
    assert spread["a"]["p"]["mesh"]["r2"] == pytest.approx({"mean": 0.6, "sd": 0.02**0.5})
    assert spread_over([cells[0], {"b": {}}], ["p"]) == {}
