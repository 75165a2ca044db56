"""What digests and atomic writes cost of a finished run.

    python -m benchmarks.checksums --run demo

Beside what the stages took it takes the time to hash every array and file as often as a stage does
that makes it (for the manifest, and once more where a resumed stage would look), to look for
numbers that are not finite, and to bring a folder into place.
"""

from __future__ import annotations

import json
import shutil
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from bridge.runs import Artifact, ArtifactWriter, Run, read_artifact
from bridge.runs.files import MANIFEST, arrays_sha256
from bridge.runs.writer import provenance

MARKED = {"truth": ("offsets",), "align": ("offsets", "theta", "frame_error")}
MARKED["align_robust"] = MARKED["align"]
"""Arrays whose rows are hashed when they are written, for who goes on after a kill."""


@dataclass(frozen=True)
class ChecksumsConfig:
    """Time the digests of a run."""

    run: str = "demo"
    """A finished run."""
    out: Path = Path("docs/results/reliability/checksums.json")
    """File to write."""


def main(config: ChecksumsConfig) -> None:
    """Measure each stage, print a line for it, write the sums."""
    run = Run(config.run)
    stages = sorted(path.parent.name for path in run.path.glob(f"*/{MANIFEST}"))
    artifacts = [run.artifact(stage) for stage in stages]
    seconds = {artifact.path.name: cost_s(artifact) for artifact in artifacts}
    took = {a.path.name: a.manifest["provenance"]["wall_time_s"] for a in artifacts}
    for stage, cost in seconds.items():
        sys.stdout.write(f"{stage:<14}{cost:>8.2f} s of {took[stage]:>8.1f} s\n")
    result = {
        "run": config.run,
        "machine": provenance(0.0)["machine"],
        "seconds": sum(seconds.values()),
        "stages_s": sum(took.values()),
        "share": sum(seconds.values()) / sum(took.values()),
    }
    sys.stdout.write(f"in all {100 * result['share']:.2f} %\n")
    config.out.parent.mkdir(parents=True, exist_ok=True)
    config.out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


def cost_s(artifact: Artifact) -> float:
    """Seconds of one stage: its digests, its marks, and `finish` of a copy of it."""
    marked = {name: artifact.array(name) for name in MARKED.get(artifact.path.name, ())}
    return _seconds(lambda: arrays_sha256(marked)) + _finish_s(artifact)


def _finish_s(artifact: Artifact) -> float:
    """Seconds of `ArtifactWriter.finish` over links to the artifact's files."""
    place = artifact.path.with_name(f".{artifact.path.name}.timed")
    writer = ArtifactWriter(place, artifact.manifest["kind"], data=artifact.origin)
    try:
        for name in artifact.digests:
            path = writer.file_path(name)
            path.hardlink_to(artifact.path / name)
        for name, entry in artifact.manifest["arrays"].items():
            writer.array_file(name, tuple(entry["shape"]), entry["dtype"], entry["unit"])
        seconds = _seconds(writer.finish)
        read_artifact(place)
    finally:
        writer.discard()
        shutil.rmtree(place, ignore_errors=True)
    return seconds


def _seconds(work: Callable[[], Any]) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


if __name__ == "__main__":
    main(tyro.cli(ChecksumsConfig))
