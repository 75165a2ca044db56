"""A row of the table of claims: its verdict by rule, and where its numbers come from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from dsnet.report.pages import mesh_score, plus_minus, smpl_name

Verdict = Literal["holds", "in part", "does not hold here", "needs the licensed data"]
HOLDS: Verdict = "holds"
PART: Verdict = "in part"
FAILS: Verdict = "does not hold here"
LICENSED: Verdict = "needs the licensed data"
DEMO, PAPER_RUN = "demo/report.md", "paper/report.md"
COMPARISON, SUBSPACES, SPEED = (
    "comparison.md",
    "subspaces/subspaces.md",
    "demo/speed.md",
)
GPU = "gpu/torch.json"
STUDY, GAINS = "claims/align_robust-0.json", "claims/alignment.json"
PAPERS_STUDY = "claims/paper-0.json"
BATCH_NORM, SECONDS = "claims/batch_norm.json", "claims/seconds.json"
COMMANDS = {
    DEMO: ("demo", "./reproduce.sh"),
    PAPER_RUN: ("paper", "./reproduce.sh --profile paper"),
    STUDY: ("networks", "python -m benchmarks.claims.networks --out DIR --seeds 0 1 2"),
    PAPERS_STUDY: (
        "on the paper's ground",
        "python -m benchmarks.claims.networks --out DIR --seeds 0 --reading paper",
    ),
    BATCH_NORM: ("range", "python -m benchmarks.claims.batch_norm --out FILE"),
    SECONDS: ("seconds", "python -m benchmarks.claims.seconds --out FILE"),
    GAINS: ("alignment", "python -m benchmarks.claims.alignment --out FILE"),
    COMPARISON: ("comparison", "python -m benchmarks.prediction.comparison --out DIR"),
    SUBSPACES: ("subspaces", "python -m benchmarks.subspaces --out DIR"),
    SPEED: ("speed", "python -m benchmarks.speed --run demo"),
    GPU: ("the same on a GPU", "python -m benchmarks.speed.autoencoder"),
    "../markers.md": ("markers", "dsnet evaluate --markers FILE --out DIR"),
}
"""What each page or file beside `claims.md` is called in the table, and what makes it."""
DSNET = "dsnet_pca"
"""The network whose layers and changes are studied."""


class Claim(NamedTuple):
    """A row of the table."""

    claim: str
    place: str
    measured: str
    verdict: Verdict
    sources: tuple[str, ...]
    on_papers_ground: str = ""
    """What was measured there; alone, where `measured` is empty, and then the verdict is of it."""
    verdict_there: Verdict | None = None

    @property
    def said(self) -> str:
        """The verdict; both, where the grounds differ."""
        if self.verdict_there in (None, self.verdict):
            return self.verdict
        return f"{self.verdict}; {_THERE[self.verdict_there]} on the paper's ground"

    @property
    def counted_as(self) -> Verdict:
        """The verdict; in part, where the grounds differ."""
        return self.verdict if self.verdict_there in (None, self.verdict) else PART


_THERE = {HOLDS: "holds", PART: "in part", FAILS: "not"}


def rule(good: bool | np.bool_, half: bool | np.bool_ = False) -> Verdict:
    """Holds, holds in part, or does not."""
    return HOLDS if good else PART if half else FAILS


def clearly_less(ones: Sequence[float], others: Sequence[float]) -> bool:
    """Whether the means of seeds are farther apart than the mean of their spreads."""
    spreads = [float(np.std(v, ddof=1)) if len(v) > 1 else 0.0 for v in (ones, others)]
    return bool(np.mean(ones) + np.mean(spreads) < np.mean(others))


def default_of(run: dict[str, Any]) -> str:
    return run["pipelines"]["paper"]["default"]


def smpl_mm(run: dict[str, Any], cell: str) -> float:
    return run["cells"][cell][smpl_name(run, "paper")]["mesh"]["mean_mm"]


def best_r2(run: dict[str, Any], cell: str) -> float:
    """The better of the paper pipeline's networks, in the mean of its seeds."""
    names = run["pipelines"]["paper"]["predictors"]
    return max(mesh_score(run, cell, name, "r2")[0] for name in names)


def left_of(run: dict[str, Any], cell: str) -> str:
    """What each of the paper pipeline's networks leaves of SMPL's error."""
    found = []
    for name in run["pipelines"]["paper"]["predictors"]:
        label = run["predictors"][name]
        mm, r2 = (plus_minus(mesh_score(run, cell, name, number)) for number in ("mean_mm", "r2"))
        found.append(f"{label.partition(', ')[2] or label} {mm} mm (R² {r2})")
    return f"{', '.join(found)}, SMPL alone {smpl_mm(run, cell):.2f}"
