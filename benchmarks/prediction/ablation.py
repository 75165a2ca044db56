"""`python -m benchmarks.prediction.ablation --out DIR`: what made the difference, one by one.

Every row is `dsnet_plus` with one part left out or one number changed, trained on the same aligned
offsets with the same seed. A row is a file: what is there is kept, and the command goes on.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.prediction.corpora import CORPORA, check_names, dsnet, prepare, scores, train_plus
from benchmarks.processes import run_as_process, run_module
from bridge.motion.splits import CELLS
from bridge.runs.files import write_text_atomically

VARIANTS: dict[str, tuple[str, ...]] = {
    "all of it": (),
    "no gravity among the loads": ("--no-gravity",),
    "nodes do not pull at each other": ("--no-coupling",),
    "skin under tension that does not resist bending": ("--no-bending",),
    "springs do not stiffen": ("--no-stiffening",),
    "flesh that does not hang": ("--no-sag",),
    "springs alike along and across the skin": ("--no-anisotropy",),
    "shape tells nothing": ("--no-by-shape",),
    "only from the data's own past": ("--no-through-time",),
    "no static part": ("--no-static",),
    "no look-ahead": ("--look-ahead", "0"),
    "250 nodes": ("--nodes", "250"),
    "half the training": ("--rounds", "5"),
}
"""Options of `benchmarks.prediction.lesser_plus` by what they mean."""
_PAGE = """\
# What made the difference (synthetic data, corpus `{corpus}`, seed {seed})

{table}

R² of the offsets against the simulated truth in each cell; one change at a time. Made by
`{command}`.
"""


@dataclass(frozen=True)
class AblationConfig:
    """Train what is missing, and tabulate all."""

    out: Path
    """Folder that receives a row a file, ablation.json and ablation.md."""
    corpus: str = "own"
    """Which corpus of the test bed."""
    seed: int = 0
    """Training seed of every row."""
    profile: str = "demo"
    """Sizes: smoke, demo or paper."""
    prefix: str = "bed"
    """The run is <prefix>_<corpus>, as in the test bed."""


def main(config: AblationConfig) -> dict[str, Any]:
    """Write the results; also returns them.

    Raises
    ------
    DsnetError
        If there is no such corpus.
    """
    check_names([config.corpus], tuple(CORPORA), "corpora")
    config.out.mkdir(parents=True, exist_ok=True)
    run = f"{config.prefix}_{config.corpus}"
    for place, (name, options) in enumerate(VARIANTS.items()):
        path = config.out / f"row-{place}.json"
        if path.exists() and json.loads(path.read_text(encoding="utf-8"))["options"] == list(
            options
        ):
            continue
        prepare(run, config.profile, config.corpus, None)
        _train(run, config, options)
        cells = scores(run, config.profile)["cells"]
        row = {"name": name, "options": list(options), "r2": _r2(cells)}
        write_text_atomically(path, json.dumps(row, indent=1, allow_nan=False) + "\n")
    rows = [
        json.loads((config.out / f"row-{n}.json").read_text(encoding="utf-8"))
        for n in range(len(VARIANTS))
    ]
    command = " ".join(["python", "-m", "benchmarks.prediction.ablation", *sys.argv[1:]])
    results = {"rows": rows, "corpus": config.corpus, "seed": config.seed, "command": command}
    text = json.dumps(results, indent=1, allow_nan=False) + "\n"
    write_text_atomically(config.out / "ablation.json", text)
    write_text_atomically(config.out / "ablation.md", markdown(results))
    return results


def _train(run: str, config: AblationConfig, options: tuple[str, ...]) -> None:
    if not options:
        train_plus(run, config.profile, config.seed)
        return
    common = ("--run", run, "--profile", config.profile, "--seed", str(config.seed))
    run_module("benchmarks.prediction.lesser_plus", *common, *options)
    dsnet("infer", run, config.profile)


def markdown(results: Mapping[str, Any]) -> str:
    """A page with one table: a row for each change."""
    rows = ["| change | options | " + " | ".join(CELLS.values()) + " |",
            "|---|---|" + "---:|" * len(CELLS)]  # fmt: skip
    for row in results["rows"]:
        values = ["" if row["r2"].get(c) is None else f"{row['r2'][c]:.3f}" for c in CELLS]
        options = f"`{' '.join(row['options'])}`" if row["options"] else ""
        rows.append(f"| {row['name']} | {options} | " + " | ".join(values) + " |")
    return _PAGE.format(**{**results, "table": "\n".join(rows)})


def _r2(cells: Mapping[str, Any]) -> dict[str, float | None]:
    found = {cell: cells.get(cell, {}).get("dsnet_plus", {}) for cell in CELLS}
    return {cell: one.get("offsets", {}).get("r2") for cell, one in found.items()}


if __name__ == "__main__":
    run_as_process(AblationConfig, main)
