"""`python -m benchmarks.held_out --out DIR --run RUN`: what the code gains from a clip it is given.

The paper draws the autoencoder's frames from all sequences, the validation sequence too. Tabulates
a `dsnet train-ae --comparisons all_frames`: the same training with and without that sequence, and
PCA without it.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.processes import run_as_process
from bridge.errors import DsnetError
from bridge.motion import sequences_of
from bridge.runs import Run
from bridge.runs.files import write_text_atomically

_ALL_FRAMES = "all_frames"


@dataclass(frozen=True)
class HeldOutConfig:
    """Tabulate a finished stage `train-ae`."""

    out: Path
    """Folder that receives held_out.json."""
    run: str = "demo"
    """Run whose autoencoder was trained with `--comparisons all_frames`."""


def main(config: HeldOutConfig) -> dict[str, Any]:
    """Write the results; also returns them.

    Raises
    ------
    DsnetError
        If the run has no such training.
    """
    run = Run(config.run)
    results = _results(run)
    config.out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(results, indent=1, allow_nan=False) + "\n"
    write_text_atomically(config.out / "held_out.json", text)
    return results


def _results(run: Run) -> dict[str, Any]:
    trained = run.artifact("train-ae")
    manifest = trained.manifest
    compared = {one["name"]: one for one in manifest["comparisons"]}
    if _ALL_FRAMES not in compared or manifest["autoencoder"]["r2_held_out"] is None:
        raise DsnetError(
            f"run {run.name!r} without a held-out clip or without `{_ALL_FRAMES}` beside it",
            "an autoencoder trained both ways",
            f"Run `dsnet train-ae --run {run.name} --comparisons {_ALL_FRAMES}`.",
        )
    clips = [s.name for s in sequences_of(run.artifact("align")) if s.split != "train"]
    without, everything = "training sequences", "all sequences"
    return {
        "data": trained.origin,
        "clips": ", ".join(f"`{name}`" for name in clips),
        "rows": [
            _row("autoencoder", without, manifest["autoencoder"]),
            _row("autoencoder, as in the paper", everything, compared[_ALL_FRAMES]),
            _row(f"PCA, {manifest['pca']['components']} components", without, manifest["pca"]),
        ],
        "steps": manifest["autoencoder"]["steps_taken"],
        "preset": manifest["autoencoder"]["preset"],
        "seed": manifest["config"]["seed"],
        "made_by": " ".join(manifest["provenance"]["command"]),
        "command": " ".join(["python", "-m", "benchmarks.held_out", *sys.argv[1:]]),
    }


def _row(code: str, drawn_from: str, scores: dict[str, Any]) -> dict[str, Any]:
    kept = {name: scores[name] for name in ("r2_validation", "r2_held_out")}
    return {"code": code, "drawn_from": drawn_from, **kept}


if __name__ == "__main__":
    run_as_process(HeldOutConfig, main)
