"""Write what the stages of a finished run took into bridge/plan/rates.py.

python tools/update_rates.py RUN       after `./reproduce.sh --run RUN`, with both roads
"""

from __future__ import annotations

import sys
from pathlib import Path

from bridge.motion import sequences_of
from bridge.plan.costs import Material, rate_name, works
from bridge.runs import Artifact, Run, read_artifact
from bridge.runs.folders import MANIFEST

RATES = Path(__file__).parents[1] / "bridge" / "plan" / "rates.py"
_MODULE = '''\
"""What the stages of a measured run took; written by tools/update_rates.py, never typed."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Rate:
    """One stage's cost in the measured run."""

    seconds: float
    """Wall time."""
    amount: float
    """Work done in it, as `bridge.plan.costs` counts it."""
    memory_mb: int
    """Largest resident memory."""


@dataclass(frozen=True)
class MeasuredRun:
    """Where the rates are from."""

    run: str
    machine: str
    day: str
    """When it ended, UTC."""


MEASURED = MeasuredRun("{run}", "{machine}", "{day}")
RATES = {{
{rates}
}}
'''


def main() -> None:
    """Refresh the rates from the run that is named on the command line."""
    (name,) = sys.argv[1:]
    RATES.write_text(rates_module(name, finished_stages(Run(name).path)), encoding="utf-8")


def finished_stages(run: Path) -> dict[str, Artifact]:
    """Every artifact in a run's folder."""
    folders = sorted(path.parent for path in run.glob(f"*/{MANIFEST}"))
    return {folder.name: read_artifact(folder) for folder in folders}


def rates_module(run: str, stages: dict[str, Artifact]) -> str:
    """The text of the module."""
    settings = {name: stage.manifest["config"] for name, stage in stages.items()}
    material = Material(sequences_of(stages["predict"]))
    rows = []
    for name, work in works(settings, material).items():
        made = stages[name].manifest["provenance"]
        seconds, memory = made["wall_time_s"], made["peak_memory_mb"]
        numbers = f"{seconds:.1f}, {round(work.amount)}, {memory}"
        rows.append(f'    "{rate_name(name, settings)}": Rate({numbers}),')
    last = stages["report"].manifest["provenance"]
    return _MODULE.format(
        run=run,
        machine=last["machine"],
        day=last["finished_utc"].partition("T")[0],
        rates="\n".join(rows),
    )


if __name__ == "__main__":
    main()
