"""Copy finished reports into docs/results and write the numbers of `demo` into README.

    python -m tools.update_readme RUN ...       after `./reproduce.sh --run RUN`

The blocks between `<!-- NAME: ... -->` and `<!-- end -->` are generated, never typed;
`tests/test_readme.py` compares them with docs/results.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
from pathlib import Path
from typing import Any

from benchmarks.claims.__main__ import PAGE, counted, page
from benchmarks.claims.claims import claims
from benchmarks.claims.results import KNOWN, NEW, NEW_UNSEEN, UNSEEN, Results
from bridge.runs import Run
from dsnet.report.pages import mesh_score, plus_minus, smpl_name
from tools.speed_page import speed_page

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
SPEED = ROOT / "docs" / "results" / "demo" / "speed.md"
KEPT_JSON = ("results", "disk")
KEPT = ("report.md", "results.json", "figures")
_BLOCK = re.compile(
    r"(<!-- (?P<name>\w+): written by tools/update_readme.py -->\n).*?(?=<!-- end -->)", re.DOTALL
)


def main() -> None:
    """Refresh docs/results from the runs that are named on the command line, and the pages that
    quote them: README, docs/claims.md, the page of speed."""
    for run in sys.argv[1:]:
        keep(Run(run).path, ROOT / "docs" / "results" / run)
    SPEED.write_text(speed_page(load_bench(SPEED.parent)), encoding="utf-8")
    text = with_results(README.read_text(encoding="utf-8"), load_results("demo"))
    README.write_text(text, encoding="utf-8")
    PAGE.write_text(page(), encoding="utf-8")


def keep(run: Path, target: Path) -> None:
    """Copy a run's report, and its bench if it has one; note what run and environment weigh."""
    target.mkdir(parents=True, exist_ok=True)
    runs = (run, *run.parent.glob(f"{run.name}-seed*"))
    disk = {"run": sum(map(_size, runs)), "environment": _size(ROOT / ".venv")}
    (target / "disk.json").write_text(json.dumps(disk) + "\n", encoding="utf-8")
    for source in (*(run / "report" / name for name in KEPT), run / "bench"):
        if source.is_dir():
            shutil.rmtree(target / source.name, ignore_errors=True)
            shutil.copytree(source, target / source.name)
        elif source.exists():
            shutil.copy2(source, target / source.name)


def load_results(run: str) -> dict[str, Any]:
    """The committed results of a run."""
    folder = ROOT / "docs" / "results" / run
    results, disk = (
        json.loads((folder / f"{name}.json").read_text(encoding="utf-8")) for name in KEPT_JSON
    )
    return {**results, "disk": disk}


def load_bench(folder: Path) -> dict[str, Any]:
    """What `python -m benchmarks.speed` measured, by part."""
    files = (folder / "bench").glob("*.json")
    return {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in files}


def with_results(page: str, results: dict[str, Any]) -> str:
    """A page's text with each of its generated blocks written anew."""
    blocks = {
        "times": lambda: times_block(results, load_results("paper")),
        "verdict": lambda: verdict_block(load_results("paper"), results, Results()),
    }
    return _BLOCK.sub(lambda found: found[1] + blocks[found["name"]](), page)


def times_block(demo: dict[str, Any], paper: dict[str, Any]) -> str:
    """How long both runs took, where, and what they need."""
    return (
        f"Without their reports, {_times('demo', demo)};\n{_times('paper', paper)}. "
        f"The environment takes {demo['disk']['environment'] / 1e9:.1f} GB.\n"
    )


def _times(run: str, results: dict[str, Any]) -> str:
    # Verification is a command of its own, no stage of ./reproduce.sh.
    stages = [stage for name, stage in results["stages"].items() if name != "verify"]
    again = results.get("seeds_took_s", {})
    minutes = (sum(stage["wall_time_s"] for stage in stages) + sum(again.values())) / 60
    seeds = f" from {1 + len(again)} seeds" if again else ""
    memory = max(stage["peak_memory_mb"] for stage in stages) / 1000
    return (
        f"[`{run}`](docs/results/{run}/report.md#how-it-was-made) took {minutes:.0f} minutes"
        f"{seeds}, {memory:.1f} GB of memory and {results['disk']['run'] / 1e9:.1f} GB of disk "
        f"({stages[0]['machine']})"
    )


def verdict_block(paper: dict[str, Any], demo: dict[str, Any], studied: Results) -> str:
    """Whether the paper holds, in three bullets, by the run at the paper's size."""
    r2 = {cell: _left(paper, cell)[1] for cell in (KNOWN, NEW, UNSEEN, NEW_UNSEEN)}
    whole = paper["alignments"]["align"]["absorption"]["whole"]
    lines = [
        f"**Claims**: {counted(claims(studied))} "
        "([each with its number and command](docs/claims.md)).",
        f"**DSNet** reduces SMPL's error on a held-out jump {_reduced(paper, 'validation')}, in "
        f"`demo` {_reduced(demo, 'validation')}. It does not generalise: R² is {r2[KNOWN]} for "
        f"known people and {r2[NEW]} for new people in new takes of known motions, {r2[UNSEEN]} "
        f"and {r2[NEW_UNSEEN]} in unseen motions. One reason: the paper's aligner puts "
        f"{100 * whole['absorbed']:.0f} % of the soft tissue's movement into pose and shape and "
        f"adds {whole['invented_mm']:.1f} mm of spurious offsets ([findings](docs/findings.md)).",
        "**DSNet+**, which takes inertial and gravitational loads as input in place of the pose, "
        f"reduces it {_reduced(paper, 'validation', 'best')} on that clip, and "
        f"{_reduced(paper, NEW_UNSEEN, 'best')} in unseen motions of new people.",
    ]
    return "\n".join(f"- {line}" for line in lines) + "\n"


def _reduced(results: dict[str, Any], cell: str, pipeline: str = "paper") -> str:
    """From SMPL's error to that of the best of a pipeline's predictors."""
    (smpl, left), r2 = _left(results, cell, pipeline)
    return f"from {smpl:.2f} to {left:.2f} mm (R² {r2})"


def _left(
    results: dict[str, Any], cell: str, pipeline: str = "paper"
) -> tuple[tuple[float, float], str]:
    """SMPL's mean error in mm and that of the best of a pipeline's predictors, and its R²."""
    least, best = min(
        (mesh_score(results, cell, name, "mean_mm"), name)
        for name in results["pipelines"][pipeline]["predictors"]
    )
    smpl = results["cells"][cell][smpl_name(results, pipeline)]["mesh"]["mean_mm"]
    return (smpl, least[0]), plus_minus(mesh_score(results, cell, best, "r2"))


def _size(folder: Path) -> int:
    """Bytes of the files below a folder."""
    return sum(path.lstat().st_size for path in folder.resolve().rglob("*") if not path.is_dir())


if __name__ == "__main__":
    main()
