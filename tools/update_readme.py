"""Copy finished reports into docs/results and write the numbers of `demo` into README.

    python -m tools.update_readme RUN ...       after `./reproduce.sh --run RUN`

The blocks between `<!-- NAME: ... -->` and `<!-- end -->` are generated, never typed;
`tests/test_readme.py` compares them, and the page of `demo`'s speed, with docs/results/demo.
"""

from __future__ import annotations

import json
import math
import re
import shutil
import sys
import time
from calendar import timegm
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bridge.motion.splits import CELLS
from bridge.runs import Run
from bridge.runs.run import TRAIN_PLUS
from tools.speed_page import speed_page

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
SPEED = ROOT / "docs" / "results" / "demo" / "speed.md"
KEPT_JSON = ("results", "disk")
KEPT = ("report.md", "results.json", "figures")
_BLOCK = re.compile(
    r"(<!-- (?P<name>\w+): written by tools/update_readme.py -->\n).*?(?=<!-- end -->)", re.DOTALL
)
SHOWN = ("validation", *CELLS)
BESIDE = ("person_mean", "smpl")


def main() -> None:
    """Refresh docs/results from the runs that are named on the command line, and the pages."""
    for run in sys.argv[1:]:
        keep(Run(run).path, ROOT / "docs" / "results" / run)
    SPEED.write_text(speed_page(load_bench(SPEED.parent)), encoding="utf-8")
    page = with_results(README.read_text(encoding="utf-8"), load_results("demo"))
    README.write_text(page, encoding="utf-8")


def keep(run: Path, target: Path) -> None:
    """Copy a run's report, and its bench if it has one; note what run and environment weigh."""
    target.mkdir(parents=True, exist_ok=True)
    disk = {"run": _size(run), "environment": _size(ROOT / ".venv")}
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
    minutes = _busy_s(stages) / 60
    memory = max(stage["peak_memory_mb"] for stage in stages) / 1000
    return (
        f"[`{run}`](docs/results/{run}/report.md#how-it-was-made) took {minutes:.0f} minutes, "
        f"{memory:.1f} GB of memory and {results['disk']['run'] / 1e9:.1f} GB of disk "
        f"({stages[0]['machine']})"
    )


def _busy_s(stages: Sequence[Mapping[str, Any]]) -> float:
    """Seconds in which a stage was at work: some are at the same time, and a run may pause."""
    if any("finished_utc" not in stage for stage in stages):
        return sum(stage["wall_time_s"] for stage in stages)
    times = [time.strptime(stage["finished_utc"], "%Y-%m-%dT%H:%M:%SZ") for stage in stages]
    ends = [timegm(one) for one in times]
    spans = sorted((end - one["wall_time_s"], end) for one, end in zip(stages, ends, strict=True))
    busy, until = 0.0, -math.inf
    for start, end in spans:
        busy += max(0.0, end - max(start, until))
        until = max(until, end)
    return busy


def results_block(results: dict[str, Any]) -> str:
    """Both pipelines' predictors side by side, on the held-out sequence and in the four cells."""
    trained = [name for one in results["pipelines"].values() for name in one["predictors"]]
    names = [*(name for name in results["predictors"] if name in trained), *BESIDE]
    labels = [results["predictors"][name] for name in names]
    cells = {cell: results["cell_titles"][cell] for cell in SHOWN if cell in results["cells"]}
    rows = [
        f"| {title} | {' | '.join(_r2_and_mm(results['cells'][cell], name) for name in names)} |"
        for cell, title in cells.items()
    ]
    return "\n".join(
        [
            f"| R² of the offsets, mean error of the posed mesh | {' | '.join(labels)} |",
            "|---" + "|---:" * len(names) + "|",
            *rows,
            "",
            *_pipeline_lines(results),
            f"Profile `{results['run']}`, seed {_seed(results)}, "
            f"{results['data']} data{_test_bed(results['test_bed'])}; every number: "
            f"[docs/results/{results['run']}](docs/results/{results['run']}/report.md).",
            *_alignment_lines(results["alignments"]),
            "",
        ]
    )


def _pipeline_lines(results: dict[str, Any]) -> list[str]:
    """Which column belongs to which pipeline."""
    lines = []
    for name, pipeline in results["pipelines"].items():
        labels = ", ".join(results["predictors"][one] for one in pipeline["predictors"])
        title = {"paper": "The paper's pipeline", "best": "This repository's pipeline"}[name]
        lines.append(f"{title} (aligned by `{pipeline['aligner']}`): {labels}.")
    return lines


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
    lines = []
    for name, alignment in alignments.items():
        text = f"`{name}` leaves {alignment['frame_error_mm']['mean']:.1f} mm to the mesh"
        if "absorption" in alignment:
            whole = alignment["absorption"]["whole"]
            text += (
                f"; of true offsets of {whole['true_mm']:.2f} mm (root mean square) pose and shape "
                f"absorb {round(100 * whole['absorbed'])} %,\nand {whole['invented_mm']:.2f} mm of "
                f"what it gives is invented: R² of its offsets is {alignment['offsets']['r2']:.2f}"
            )
        lines.append(f"{text}.")
    return lines


def _size(folder: Path) -> int:
    """Bytes of the files below a folder."""
    return sum(path.lstat().st_size for path in folder.resolve().rglob("*") if not path.is_dir())


def _seed(results: dict[str, Any]) -> int:
    """The seed of the run's training."""
    stages = results["stages"]
    return next(stages[name]["seed"] for name in ("train", TRAIN_PLUS) if name in stages)


def _r2_and_mm(cell: dict[str, Any], predictor: str) -> str:
    """A cell of the table; a predictor may not have been measured there."""
    errors = cell.get(predictor, {})
    r2, mean_mm = (errors.get(m, {}).get(k) for m, k in (("offsets", "r2"), ("mesh", "mean_mm")))
    return f"{_decimals(r2)}, {_decimals(mean_mm, ' mm')}"


def _decimals(value: float | None, unit: str = "") -> str:
    # Adding 0 turns the negative zero of rounding into zero.
    return "-" if value is None else f"{round(value, 2) + 0.0:.2f}{unit}"


if __name__ == "__main__":
    main()
