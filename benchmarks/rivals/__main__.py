"""`python -m benchmarks.rivals --rival sds --code CHECKOUT --run RUN --out DIR`: a rival's row.

An open system of others runs from where it lies, on the test clips of a run of the comparison.
Its settings are chosen on the validation clip and the aligned offsets there; the truth is only
scored against. The comparison's page shows every score that lies in its folder.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.prediction.comparison_rivals import rival_path
from benchmarks.prediction.corpora import CORPORA, check_names
from benchmarks.processes import run_as_process
from benchmarks.rivals.rival import Rival
from benchmarks.rivals.scoring import score_rival, validation_clips
from benchmarks.rivals.sds import SpringDecomposedSkinning
from bridge.body import BodyModelData, load_body_model
from bridge.errors import DsnetError
from bridge.runs import Run
from bridge.runs.files import write_text_atomically
from bridge.runs.run import best_alignment, body_model_path

RIVALS: dict[str, Callable[[Path, BodyModelData], Rival]] = {
    SpringDecomposedSkinning.name: SpringDecomposedSkinning
}
"""What opens each of them, given its code and a body."""


@dataclass(frozen=True)
class RivalsConfig:
    """Choose a rival's settings and score it: minutes, 2 GB."""

    rival: str
    """Which one: sds."""
    code: Path
    """Folder of its checkout."""
    run: str
    """A run of the comparison, finished up to `infer`."""
    out: Path
    """Folder of the comparison's scores; receives rivals-<corpus>-<rival>.json."""
    corpus: str = "own"
    """Which corpus the run is of."""


def main(config: RivalsConfig) -> dict[str, Any]:
    """Write the score; also returns it.

    Raises
    ------
    DsnetError
        If the rival is unknown or its code is not there, or the run lacks a stage.
    """
    check_names([config.rival], tuple(RIVALS), "rival")
    check_names([config.corpus], tuple(CORPORA), "corpora")
    run = Run(config.run)
    artifacts, align = run.artifacts("infer_plus", "truth"), best_alignment(run)
    body = load_body_model(str(body_model_path(run)))
    rival, clips = RIVALS[config.rival](config.code, body), validation_clips(align)
    if not clips:
        raise DsnetError(
            f"run {config.run!r} without a validation clip", "one at least", "Pass another run."
        )
    config.out.mkdir(parents=True, exist_ok=True)
    departures = rival.choose(clips)
    found = {
        "rival": rival.name,
        "corpus": config.corpus,
        "command": " ".join(["python", "-m", "benchmarks.rivals", *sys.argv[1:]]),
        **score_rival(rival, artifacts["infer_plus"], align, artifacts["truth"], body),
        "systems": {rival.name: {"label": rival.label, "departures": departures}},
    }
    path = rival_path(config.out, config.corpus, rival.name)
    write_text_atomically(path, json.dumps(found, indent=1, allow_nan=False) + "\n")
    return found


if __name__ == "__main__":
    run_as_process(RivalsConfig, main)
