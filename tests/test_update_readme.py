"""The README's table is made from `results.json`: both pipelines, each cell, what is missing."""

from __future__ import annotations

import pytest

from tools.update_readme import results_block, times_block

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
    return {"offsets": {"r2": r2}, "mesh": {"mean_mm": mean_mm}}


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


def test_both_pipelines_stand_in_one_table():
    block = results_block(results())
    assert block.splitlines()[:4] == [
        "| R² of the offsets, mean error of the posed mesh "
        "| DSNet plus | DSNet | mean | SMPL alone |",
        "|---|---:|---:|---:|---:|",
        "| held out, `50004_one_leg_jump` "
        "| 0.90, 1.00 mm | 0.70, 2.00 mm | 0.50, 3.00 mm | 0.30, 4.00 mm |",
        "| new person, unseen motion | 0.90, 1.00 mm | -, - | 0.50, 3.00 mm | 0.30, 4.00 mm |",
    ]
    assert "The paper's pipeline (aligned by `sgd`): DSNet." in block
    assert "This repository's pipeline (aligned by `robust`): DSNet plus." in block
    bed = "synthetic data (tissue law `own`, form `clean`, with gravity, female bodies)"
    assert f"seed 3, {bed}; every number" in block
    assert "`align` leaves 2.9 mm" in block
    assert "`align_robust` leaves 0.5 mm to the mesh." in block
    assert "R² of its offsets is -0.50." in block


@pytest.mark.parametrize(("pipeline", "column"), [("paper", "DSNet"), ("best", "DSNet plus")])
def test_one_pipeline_has_its_own_column_only(pipeline, column):
    stage = {"paper": "train", "best": "train_plus"}[pipeline]
    block = results_block(
        results(pipelines={pipeline: PIPELINES[pipeline]}, stages={stage: {"seed": 1}})
    )
    head = block.splitlines()[0]
    assert head.endswith(f"posed mesh | {column} | mean | SMPL alone |")
    assert "seed 1, " in block


def test_licensed_data_name_no_test_bed():
    block = results_block(results(data="licensed", test_bed=None))
    assert "licensed data; every number" in block
    assert "law" not in block


def test_stages_at_the_same_time_and_pauses_count_once():
    def took(*stages: tuple[str, float]) -> str:
        made = {
            str(row): {
                "wall_time_s": seconds,
                "finished_utc": f"2026-01-31T{end}Z",
                "peak_memory_mb": 1500,
                "machine": "one",
            }
            for row, (end, seconds) in enumerate(stages)
        }
        one = {"stages": made, "disk": {"run": 5e9, "environment": 2.7e9}}
        return times_block(one, one)

    assert "took 3 minutes, 1.5 GB" in took(("00:01:00", 60), ("10:00:00", 120))
    assert "took 4 minutes" in took(("10:04:00", 240), ("10:02:00", 60), ("10:03:30", 120))
    assert "took 4 minutes" in took(("10:03:00", 120), ("10:05:00", 240), ("10:00:30", 30))
