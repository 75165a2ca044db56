"""`python -m benchmarks.prediction.test_bed --out DIR`: four cells, several tissues, several seeds.

For every corpus, `dsnet_plus` is trained on the robust aligner's offsets with each seed and scored
against the truth; other systems stand beside it in `benchmarks.prediction.comparison`. What is
finished is kept: a score is a file of its own, and runs are made by `dsnet`, which resumes.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from benchmarks.prediction.corpora import (
    CORPORA,
    check_names,
    prepare,
    read_index,
    scores,
    train_plus,
    write_index,
)
from benchmarks.prediction.over_seeds import is_real, r2_of, summary, without_real
from benchmarks.processes import run_as_process
from bridge.motion.splits import CELLS
from bridge.runs.files import write_text_atomically

_INDEX = "test_bed.json"
_METRICS = {
    "offsets R²": ("offsets", "r2", "{:.3f}"),
    "moving R²": ("moving", "r2", "{:.3f}"),
    "velocity R²": ("velocity", "r2", "{:.3f}"),
    "mesh mean mm": ("mesh", "mean_mm", "{:.2f}"),
    "mesh 95 % mm": ("mesh", "p95_mm", "{:.2f}"),
}
_SHOWN = ("dsnet_plus", "person_mean_best", "smpl_best", "person_mean", "smpl")
_PAGE = """\
# The test bed: four cells, each tissue, mean over training seeds (synthetic data)

{table}

Scores against the simulated truth; everything was trained on the robust aligner's offsets. `second`
and `third` are tissue laws to test on (docs/prediction.md says what was known of each), `captured`
is the second one's captured-like form, where the moving part is scored by itself, also in the last
column. ± is the standard deviation over seeds where there are several.
Made by `{command}`.
"""


@dataclass(frozen=True)
class TestBedConfig:
    """Make what is missing, and tabulate all."""

    out: Path
    """Folder that receives a score a file, test_bed.json and test_bed.md."""
    corpora: tuple[str, ...] = tuple(CORPORA)
    """Which corpora: tissue law, form and gender."""
    seeds: tuple[int, ...] = (0, 1, 2)
    """Training seeds."""
    profile: str = "demo"
    """Sizes: smoke, demo or paper."""
    amass: Path | None = None
    """Folder of AMASS files or BVHs that become test motions too."""
    amass_fps: float | None = None
    """Frames per second of these files, where what they say of themselves is wrong."""
    amass_seconds: float | None = None
    """Longest part of each that is used; None: the 20 of `dsnet corpus`."""
    amass_smooth_hz: float | Literal["auto"] | None = None
    """What is faster in these is left out, `auto` as it suits each moment; None: nothing."""
    prefix: str = "bed"
    """Runs are named <prefix>_<corpus>."""


def main(config: TestBedConfig) -> dict[str, Any]:
    """Write the results; also returns them.

    Raises
    ------
    DsnetError
        If there is no such corpus.
    """
    check_names(config.corpora, tuple(CORPORA), "corpora")
    config.out.mkdir(parents=True, exist_ok=True)
    for corpus in config.corpora:
        _score(config, corpus)
    results = write_index(config.out / _INDEX, "benchmarks.prediction.test_bed")
    write_text_atomically(config.out / "test_bed.md", markdown(config.out))
    return results


def markdown(folder: Path) -> str:
    """A page with one table of the folder's scores: a row for each corpus, cell and predictor."""
    scores, command = read_index(folder / _INDEX)
    head = ["corpus", "cell", "predictor", "seeds", *_METRICS, "R² without real motions"]
    rows = ["| " + " | ".join(head) + " |", "|---" * 4 + "|---:" * (len(_METRICS) + 1) + "|"]
    rows += ["| " + " | ".join(row) + " |" for row in _rows(scores)]
    return _PAGE.format(table="\n".join(rows), command=command)


def _score(config: TestBedConfig, corpus: str) -> None:
    run, ready = f"{config.prefix}_{corpus}", False
    for seed in config.seeds:
        path = config.out / f"{corpus}-{seed}.json"
        if path.exists():
            continue
        if not ready:
            prepare(run, config.profile, corpus, config.amass,
                    amass_fps=config.amass_fps, amass_seconds=config.amass_seconds,
                    amass_smooth_hz=config.amass_smooth_hz)  # fmt: skip
            ready = True
        train_plus(run, config.profile, seed)
        found = {"corpus": corpus, "seed": seed, **scores(run, config.profile)}
        write_text_atomically(path, json.dumps(found, indent=1, allow_nan=False) + "\n")


def _rows(scores: Sequence[Mapping[str, Any]]) -> Iterator[list[str]]:
    for corpus in dict.fromkeys(one["corpus"] for one in scores):
        seeds = [one for one in scores if one["corpus"] == corpus]
        for cell, label in CELLS.items():
            for name in _SHOWN:
                having = [s for s in seeds if name in s["cells"].get(cell, {})]
                if having:
                    text = having[0]["labels"].get(name, name)
                    without = [_r2_without_real(s, cell, name) for s in having]
                    yield [corpus, label, text, str(len(having)),
                           *_metrics([s["cells"][cell][name] for s in having]),
                           summary(without, "{:.3f}")]  # fmt: skip
        yield from _real_rows(corpus, seeds)


def _real_rows(corpus: str, seeds: list[Mapping[str, Any]]) -> Iterator[list[str]]:
    """Real motions that were given simulated tissue, one by one; they count in their cells too."""
    for motion in filter(is_real, seeds[0]["sequences"]):
        name, label = motion["name"], seeds[0]["labels"]["dsnet_plus"]
        own = [m["errors"]["dsnet_plus"] for s in seeds for m in s["sequences"]
               if m["name"] == name]  # fmt: skip
        yield [corpus, f"real motion `{name}`", label, str(len(own)), *_metrics(own), ""]


def _metrics(own: list[Mapping[str, Any]]) -> Iterator[str]:
    for metric, key, form in _METRICS.values():
        values = [one[metric][key] for one in own if metric in one and key in one[metric]]
        yield summary(values if len(values) == len(own) else [], form)


def _r2_without_real(score: Mapping[str, Any], cell: str, name: str) -> float | None:
    """Of the offsets, or their moving part where that is known, over a cell's invented motions."""
    invented = without_real(score, cell)
    kind = "moving" if invented and "moving" in invented[0]["errors"][name] else "offsets"
    # SMPL alone has no offsets: its error is what there is to predict.
    parts = (
        (s["frames"], *(s["errors"][n][kind]["rms_mm"] for n in (name, "smpl"))) for s in invented
    )
    return r2_of(list(parts))


if __name__ == "__main__":
    run_as_process(TestBedConfig, main)
