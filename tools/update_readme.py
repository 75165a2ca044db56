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
from benchmarks.claims.results import KNOWN, NEW, NEW_UNSEEN, UNSEEN, Results, mean_sd, r2_of
from bridge.runs import Run
from bridge.runs.run import TRAIN_PLUS
from dsnet.report.pages import main_table, of_mesh, plus_minus, smpl_of
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
        "results": lambda: results_block(results),
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
    """Whether the paper holds, in five lines, by the run at the paper's size."""
    new = [_left(paper, cell) for cell in (KNOWN, NEW)]
    unseen = [_left(paper, cell) for cell in (UNSEEN, NEW_UNSEEN)]
    whole = paper["alignments"]["align"]["absorption"]["whole"]
    alone = [mean_sd(r2_of(studied.networks, "dsnet_pca", cell)) for cell in (NEW, NEW_UNSEEN)]
    best = [_left(paper, cell, "best") for cell in ("validation", NEW_UNSEEN)]
    lines = [
        f"**Claims**: {counted(claims(studied))} "
        "([each with its number and command](docs/claims.md)).",
        "**The clip that it shows**, a jump held out: DSNet's better reading leaves, of SMPL's "
        f"error, {_left(paper, 'validation')}; in `demo` {_left(demo, 'validation')}.",
        f"**New takes of known motions**: known people {new[0]}, new people {new[1]}. **Unseen "
        f"motions**: {unseen[0]} and {unseen[1]}.",
        f"**Why**: the paper's aligner puts {100 * whole['absorbed']:.0f} % of the flesh's "
        f"movement into pose and shape, and invents {whole['invented_mm']:.1f} mm. Given `demo`'s "
        f"offsets without loss, the network has R² {alone[0]} in known and {alone[1]} in unseen "
        "motions of new people: an unseen pose is its ruin.",
        "**DSNet+**, this repository's remedy, is told the force on the flesh, not the pose: "
        f"{best[0]} on that clip, {best[1]} in unseen motions of new people.",
    ]
    return "\n".join(f"- {line}" for line in lines) + "\n"


def _left(results: dict[str, Any], cell: str, pipeline: str = "paper") -> str:
    """What the best of a pipeline's predictors leaves of its SMPL's error."""
    least, best = min(
        (of_mesh(results, cell, name, "mean_mm"), name)
        for name in results["pipelines"][pipeline]["predictors"]
    )
    smpl = results["cells"][cell][smpl_of(results, pipeline)]["mesh"]["mean_mm"]
    r2 = of_mesh(results, cell, best, "r2")
    return f"{least[0]:.2f} of {smpl:.2f} mm (R² {plus_minus(r2)})"


def results_block(results: dict[str, Any]) -> str:
    """Both pipelines in the test groups, and what each alignment keeps of the truth."""
    return "\n".join(
        [
            main_table(results),
            "",
            f"Profile `{results['run']}`, seed {_seed(results)}, "
            f"{results['data']} data{_test_bed(results['test_bed'])}; every number: "
            f"[docs/results/{results['run']}](docs/results/{results['run']}/report.md).",
            *_alignment_lines(results["alignments"]),
            "",
        ]
    )


def _test_bed(bed: dict[str, Any] | None) -> str:
    """Tissue law and form, gravity and bodies of the corpus, where it is synthetic."""
    if bed is None:
        return ""
    gravity = "with" if bed["gravity"] else "without"
    return (
        f" (tissue law `{bed['tissue']}`, form `{bed['form']}`, {gravity} gravity, "
        f"{bed['gender']} bodies)"
    )


def _alignment_lines(alignments: dict[str, dict[str, Any]]) -> list[str]:
    """What each alignment keeps of the truth, where there is one."""
    return [
        f"R² of what `{name}` gives, against the true offsets: {one['offsets']['r2']:.2f}."
        for name, one in alignments.items()
        if "offsets" in one
    ]


def _size(folder: Path) -> int:
    """Bytes of the files below a folder."""
    return sum(path.lstat().st_size for path in folder.resolve().rglob("*") if not path.is_dir())


def _seed(results: dict[str, Any]) -> int:
    """The seed of the run's training."""
    stages = results["stages"]
    return next(stages[name]["seed"] for name in ("train", TRAIN_PLUS) if name in stages)


if __name__ == "__main__":
    main()
