"""`python -m benchmarks.alignment.laws --out FILE.json --runs ...`: the robust aligner by law.

Of runs of the test bed, which have aligned meshes and the truth: how much of the true offsets the
aligner gives back over all sequences, and of which one least.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.processes import run_as_process
from bridge.motion import sequences_of
from bridge.runs import Run
from bridge.runs.files import write_text_atomically
from bridge.runs.run import best_alignment
from dsnet.evaluation.metrics import ErrorSums


@dataclass(frozen=True)
class LawsConfig:
    """Write what the aligner gives back."""

    out: Path
    """A .json."""
    runs: tuple[str, ...]
    """With aligned meshes and the truth."""


def main(config: LawsConfig) -> None:
    """Write it.

    Raises
    ------
    DsnetError
        If a run lacks either.
    """
    result = {
        "runs": {name: _scores(Run(name)) for name in config.runs},
        "command": " ".join(["python", "-m", "benchmarks.alignment.laws", *sys.argv[1:]]),
    }
    write_text_atomically(config.out, json.dumps(result, indent=1) + "\n")


def _scores(run: Run) -> dict[str, Any]:
    truth, align = run.artifact("truth"), best_alignment(run)
    places = {sequence.name: sequence for sequence in sequences_of(truth)}
    whole, by_sequence = ErrorSums(), {}
    for sequence in sequences_of(align):
        sums = ErrorSums()
        aligned_m = align.array("offsets")[sequence.frames]
        sums.add(aligned_m, truth.array("offsets")[places[sequence.name].frames])
        by_sequence[sequence.name] = round(sums.r2, 5)
        whole += sums
    config = run.artifact("corpus").manifest["config"]
    return {
        **{key: config[key] for key in ("tissue", "form", "gender")},
        "r2": round(whole.r2, 5),
        "error_mm": round(1e3 * (whole.squared_error / whole.count) ** 0.5, 4),
        "true_mm": round(1e3 * (whole.squared_reference / whole.count) ** 0.5, 4),
        "sequences": by_sequence,
    }


if __name__ == "__main__":
    run_as_process(LawsConfig, main)
