"""Write what the stages of a finished run took into bridge/plan/rates.py.

python tools/update_rates.py RUN       after `./reproduce.sh --run RUN`, with both roads
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

from bridge.motion import sequences_of
from bridge.plan.costs import Material, MeasuredRun, Rate, rate_name, works
from bridge.runs import Artifact, Run, read_artifact
from bridge.runs.folders import MANIFEST

RATES_FILE = Path(__file__).parents[1] / "bridge" / "plan" / "rates.py"
_MODULE = '''\
"""What the stages of a finished run took; written by tools/update_rates.py, never typed."""

from __future__ import annotations

from bridge.plan.costs import MeasuredRun, Rate

MEASURED = MeasuredRun("{0.run}", "{0.machine}", "{0.day}")
RATES = {{
{1}}}
'''


def main() -> None:
    """Refresh the rates from the run that is named on the command line."""
    (name,) = sys.argv[1:]
    stages = finished_stages(Run(name).path)
    RATES_FILE.write_text(rates_module(measured_run(name, stages), rates(stages)), encoding="utf-8")


def finished_stages(run: Path) -> dict[str, Artifact]:
    """Every artifact in a run's folder."""
    folders = sorted(path.parent for path in run.glob(f"*/{MANIFEST}"))
    return {folder.name: read_artifact(folder) for folder in folders}


def measured_run(name: str, stages: Mapping[str, Artifact]) -> MeasuredRun:
    """Where and when a run was made."""
    last = stages["report"].manifest["provenance"]
    return MeasuredRun(name, last["machine"], last["finished_utc"].partition("T")[0])


def rates(stages: Mapping[str, Artifact]) -> dict[str, Rate]:
    """Time, work and memory of each stage."""
    settings = {name: stage.manifest["config"] for name, stage in stages.items()}
    material = Material(sequences_of(stages["predict"]))
    found = {}
    for name, work in works(settings, material).items():
        made = stages[name].manifest["provenance"]
        # Not all mapped pages need be in memory at once.
        memory_mb = max(made["peak_memory_mb"] - work.mapped_bytes // 2**20, 0)
        rate = Rate(round(made["wall_time_s"], 1), round(work.amount), memory_mb)
        found[rate_name(name, settings)] = rate
    return found


def rates_module(measured: MeasuredRun, found: Mapping[str, Rate]) -> str:
    """The text of the module that holds them."""
    rows = (
        f'    "{name}": Rate({rate.seconds}, {rate.amount}, {rate.memory_mb}),\n'
        for name, rate in found.items()
    )
    return _MODULE.format(measured, "".join(rows))


if __name__ == "__main__":
    main()
