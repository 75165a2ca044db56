"""README's verdict and times are made from the committed `results.json`."""

from __future__ import annotations

from benchmarks.claims.results import Results
from tools.update_readme import times_block, verdict_block

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
    assert len(block.splitlines()) == 3
    assert "on a held-out jump from 4.00 to 2.00 mm (R² 0.70)" in block
    assert "from 5.00 to 1.00 mm (R² 0.90) on that clip" in block
    spread = {"mean_mm": {"mean": 2.5, "sd": 0.1}, "r2": {"mean": -0.001, "sd": 0.02}}
    both = {"dsnet": {"mesh": spread}, "dsnet_plus": {"mesh": spread}}
    several = {"cells": dict.fromkeys(shown["cells"], both)}
    block = verdict_block(shown | {"seeds": several}, shown, Results())
    assert "from 4.00 to 2.50 mm (R² 0.00 ± 0.02), in `demo` from 4.00 to 2.00 mm" in block


def test_the_time_of_every_seed_is_counted():
    stage = {"wall_time_s": 600, "peak_memory_mb": 1500, "machine": "a machine"}
    run = {"stages": {"corpus": stage, "train": stage}, "disk": {"run": 2e9, "environment": 1e9}}
    again = {"seeds_took_s": {"1": 300, "2": 300}}
    block = times_block(run, run | again)
    assert ") took 20 minutes, 1.5 GB of memory" in block
    assert ") took 30 minutes from 3 seeds, 1.5 GB of memory" in block
