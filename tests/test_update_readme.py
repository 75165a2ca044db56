"""The README's table is made from `results.json`: both pipelines, each cell, what is missing."""

from __future__ import annotations

import pytest

from benchmarks.claims.results import Results
from tools.update_readme import results_block, times_block, verdict_block

PIPELINES = {
    "paper": {"predictors": ["dsnet"], "aligner": "sgd"},
    "best": {"predictors": ["dsnet_plus"], "aligner": "robust"},
}
LABELS = {
    "dsnet_plus": "DSNet plus",
    "dsnet": "DSNet",
    "person_mean": "mean",
    "smpl": "SMPL alone",
    "smpl_best": "SMPL alone, on the best pipeline",
}


def errors(r2: float, mean_mm: float) -> dict:
    return {"offsets": {"r2": r2}, "mesh": {"r2": r2, "mean_mm": mean_mm}}


def results(**changes) -> dict:
    whole = {"true_mm": 3.2, "absorbed": 0.41, "invented_mm": 3.7}
    known = {
        "frame_error_mm": {"mean": 2.9}, "absorption": {"whole": whole}, "offsets": {"r2": -0.5}
    }  # fmt: skip
    cell = {name: errors(0.9 - 0.2 * k, 1.0 + k) for k, name in enumerate(LABELS)}
    return {
        "run": "demo",
        "data": "synthetic",
        "predictors": LABELS,
        "pipelines": PIPELINES,
        "seeds": None,
        "cells": {"validation": cell, "new_person_unseen_motion": cell | {"dsnet": {}}},
        "cell_titles": {
            "validation": "held out, `50004_one_leg_jump`",
            "new_person_unseen_motion": "new person, unseen motion",
            "train": "trained on",
        },
        "test_bed": {"tissue": "own", "form": "clean", "gravity": True, "gender": "female"},
        "stages": {"train": {"seed": 3}, "train_plus": {"seed": 3}},
        "alignments": {"align": known, "align_robust": {"frame_error_mm": {"mean": 0.5}}},
        **changes,
    }


def test_each_pipeline_stands_beside_its_own_smpl_and_a_column_has_one_reference():
    block = results_block(results())
    assert block.splitlines()[:7] == [
        "| mean error, R² | held out, `50004_one_leg_jump`, against the registered mesh "
        "| new person, unseen motion, against the true mesh |",
        "|---|---:|---:|",
        "| DSNet | 2.00 mm, 0.70 | - |",
        "| *SMPL alone, as `sgd` fitted it* | 4.00 mm, 0.30 | 4.00 mm, 0.30 |",
        "| DSNet plus | 1.00 mm, 0.90 | 1.00 mm, 0.90 |",
        "| *SMPL alone, as `robust` fitted it* | 5.00 mm, 0.10 | 5.00 mm, 0.10 |",
        "",
    ]
    bed = "synthetic data (tissue law `own`, form `clean`, with gravity, female bodies)"
    assert f"seed 3, {bed}; every number" in block
    assert "what `align` gives, against the true offsets: -0.50." in block
    assert "align_robust" not in block


@pytest.mark.parametrize(("pipeline", "label"), [("paper", "DSNet"), ("best", "DSNet plus")])
def test_one_pipeline_has_its_own_rows_only(pipeline, label):
    stage = {"paper": "train", "best": "train_plus"}[pipeline]
    block = results_block(
        results(pipelines={pipeline: PIPELINES[pipeline]}, stages={stage: {"seed": 1}})
    )
    rows = block.splitlines()[2:4]
    assert rows[0].startswith(f"| {label} |")
    assert rows[1].startswith("| *SMPL alone")
    assert "seed 1, " in block


def test_the_verdict_is_of_the_better_reading_and_its_own_smpl():
    cell = {name: errors(0.9 - 0.2 * k, 1.0 + k) for k, name in enumerate(LABELS)}
    shown = results(
        cells=dict.fromkeys(
            (
                "validation",
                "known_person_known_motion",
                "known_person_unseen_motion",
                "new_person_known_motion",
                "new_person_unseen_motion",
            ),
            cell,
        )
    )
    block = verdict_block(shown, shown, Results())
    assert len(block.splitlines()) == 5
    assert "of SMPL's error, 2.00 of 4.00 mm (R² 0.70)" in block
    assert "1.00 of 5.00 mm (R² 0.90) on that clip" in block
    spread = {"mean_mm": {"mean": 2.5, "sd": 0.1}, "r2": {"mean": -0.001, "sd": 0.02}}
    both = {"dsnet": {"mesh": spread}, "dsnet_plus": {"mesh": spread}}
    several = {"cells": dict.fromkeys(shown["cells"], both)}
    block = verdict_block(shown | {"seeds": several}, shown, Results())
    assert "2.50 of 4.00 mm (R² 0.00 ± 0.02); in `demo` 2.00 of 4.00 mm" in block


def test_the_time_of_every_seed_is_counted():
    stage = {"wall_time_s": 600, "peak_memory_mb": 1500, "machine": "a machine"}
    run = {"stages": {"corpus": stage, "train": stage}, "disk": {"run": 2e9, "environment": 1e9}}
    again = {"seeds_took_s": {"1": 300, "2": 300}}
    block = times_block(run, run | again)
    assert ") took 20 minutes, 1.5 GB of memory" in block
    assert ") took 30 minutes from 3 seeds, 1.5 GB of memory" in block


def test_licensed_data_name_no_test_bed():
    block = results_block(results(data="licensed", test_bed=None))
    assert "licensed data; every number" in block
    assert "law" not in block
