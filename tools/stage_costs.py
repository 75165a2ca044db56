"""Write what each stage of a run cost: docs/results/costs/<RUN>.md.

    python tools/stage_costs.py RUN

Wall times and memory stand in the artifacts' manifests; `tools/include_results.py` brings the table
into the pages that quote it.
"""

from __future__ import annotations

import sys
from pathlib import Path

from bridge.runs import Artifact, Run, read_artifact
from bridge.runs.folders import MANIFEST, write_text_atomically

ROOT = Path(__file__).parents[1]


def main() -> None:
    """Write the page of the run that is named on the command line."""
    run = Run(sys.argv[1])
    finished = [read_artifact(path.parent) for path in run.path.glob(f"*/{MANIFEST}")]
    finished.sort(key=lambda artifact: artifact.manifest["provenance"]["finished_utc"])
    target = ROOT / "docs" / "results" / "costs" / f"{run.name}.md"
    target.parent.mkdir(parents=True, exist_ok=True)
    write_text_atomically(target, page(run.name, finished))


def page(name: str, artifacts: list[Artifact]) -> str:
    """The table in Markdown."""
    lines = [
        f"# What the stages of run `{name}` cost",
        "",
        "| stage | frames | wall time [s] | peak memory [MB] | command |",
        "|---|---:|---:|---:|---|",
        *(_row(artifact) for artifact in artifacts),
        "",
        f"{artifacts[-1].origin.capitalize()} data;"
        f" {artifacts[-1].manifest['provenance']['machine']}.",
    ]
    return "\n".join(lines) + "\n"


def _row(artifact: Artifact) -> str:
    provenance = artifact.manifest["provenance"]
    frames = sum(sequence["length"] for sequence in artifact.manifest.get("sequences", ()))
    return (
        f"| {artifact.path.name} | {frames or ''} | {provenance['wall_time_s']:.0f} |"
        f" {provenance['peak_memory_mb']} | `{' '.join(provenance['command'])}` |"
    )


if __name__ == "__main__":
    main()
