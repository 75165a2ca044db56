"""`python -m benchmarks.alignment.readings --out FILE`: what Section 3.3 leaves open, tried.

The fit of a frame is the closest of all iterates or the last one, and a shape is that of a subject
or of a sequence. Each reading aligns one corpus by SGD, the profile's with clips of a second, and
its offsets are compared with the truth.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.processes import run_as_process, run_dsnet
from bridge.body import load_paper_body
from bridge.runs import Run
from bridge.runs.files import write_text_atomically
from bridge.runs.run import ALIGNMENT, body_model_path
from dsnet.evaluation.alignment import alignment_errors
from dsnet.evaluation.pipelines import MotionArrays

READINGS: Mapping[str, tuple[str, ...]] = {
    "closest": (),
    "last": ("--iterate", "last"),
    "sequence": ("--betas-per", "sequence"),
}
"""By name, the options of `dsnet align`; the first is what every run does."""


@dataclass(frozen=True)
class ReadingsConfig:
    """Align a corpus in each reading; what is done is kept."""

    out: Path
    """File for the results."""
    run: str = "readings"
    """Run for the corpus; those of the readings begin with its name."""
    profile: str = "demo"
    """Whose people, motions and steps of SGD."""
    subjects: int = 2
    """How many people."""
    frames: int = 60
    """Mean length of a clip."""


def main(config: ReadingsConfig) -> None:
    source = Run(config.run)
    run_dsnet(
        *("corpus", "--run", source.name, "--profile", config.profile),
        *("--mean-frames", str(config.frames), "--subjects", str(config.subjects)),
    )
    found = {name: _errors(config, source, name) for name in READINGS}
    machine = source.artifact("corpus").manifest["provenance"]["machine"]
    settings = {"profile": config.profile, "subjects": config.subjects, "frames": config.frames}
    results = {**settings, "machine": machine, "readings": found}
    write_text_atomically(config.out, json.dumps(results, indent=1) + "\n")


def _errors(config: ReadingsConfig, source: Run, name: str) -> dict[str, Any]:
    run = Run(f"{source.name}-align-{name}")
    run.path.mkdir(parents=True, exist_ok=True)
    for stage in ("corpus", "truth"):
        if not (run.path / stage).exists():
            (run.path / stage).symlink_to(Path("..") / source.path.name / stage)
    common = ("--run", run.name, "--profile", config.profile, "--aligner", "sgd")
    run_dsnet("align", *common, *READINGS[name])
    align, truth = (MotionArrays.of(run.artifact(stage)) for stage in (ALIGNMENT, "truth"))
    body = load_paper_body(str(body_model_path(run)))
    errors = alignment_errors(align, truth, body)
    absorbed = errors["absorption"]["whole"]
    return {
        "options": READINGS[name],
        "distance_mm": errors["frame_error_mm"]["mean"],
        "offsets_r2": errors["offsets"]["r2"],
        "betas_rms": errors["betas_rms"],
        "pose_deg": errors["pose_deg"]["mean"],
        "absorption": absorbed,
    }


if __name__ == "__main__":
    run_as_process(ReadingsConfig, main)
