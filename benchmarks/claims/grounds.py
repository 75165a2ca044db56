"""The two grounds on which claims of the network are measured, and a row of both."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.claims.results import HELD_OUT, KNOWN, NEW, UNSEEN, Results, mean_sd, r2_of
from benchmarks.claims.row import DSNET, PAPERS_STUDY, STUDY, Claim, Verdict

SAID = {
    KNOWN: "in known motions of known people",
    NEW: "of new people",
    UNSEEN: "in unseen motions",
    HELD_OUT: "on the held-out jump",
}


@dataclass(frozen=True)
class Ground:
    """What networks learned from, and where they are judged."""

    seeds: Sequence[dict[str, Any]]
    """Results, a training seed each."""
    cells: tuple[str, ...]
    """Test groups that are reported; the first one decides."""

    def r2(self, system: str, cell: str = "") -> float:
        """Of the seeds' mean."""
        return float(np.mean(r2_of(self.seeds, system, cell or self.cells[0])))

    def said(self, system: str, cell: str = "") -> str:
        """With its spread."""
        return mean_sd(r2_of(self.seeds, system, cell or self.cells[0]))

    def beside(self, system: str, name: str) -> str:
        """DSNet and another, by test group."""
        first, *rest = (
            (SAID[cell], self.said(DSNET, cell), self.said(system, cell)) for cell in self.cells
        )
        others = "".join(f"; {cell} {ours} and {its}" for cell, ours, its in rest)
        return f"R² {first[0]} {first[1]}, {name} {first[2]}{others}"


Measure = Callable[[Ground], tuple[str, Verdict]]
"""What is reported of one ground, and the verdict there."""


def on_both(results: Results, claim: str, place: str, measure: Measure, *systems: str) -> Claim:
    """A row of what both studies measured; of one, while the paper's lacks the `systems`."""
    fair = measure(Ground(results.networks, (KNOWN, NEW, UNSEEN)))
    seeds = [
        one
        for one in results.papers_networks
        if all(name in one["systems"] for name in (DSNET, *systems))
    ]
    if not seeds:
        return Claim(claim, place, fair[0], fair[1], (STUDY,))
    papers = measure(Ground(seeds, (HELD_OUT, KNOWN, UNSEEN)))
    return Claim(claim, place, fair[0], fair[1], (STUDY, PAPERS_STUDY), *papers)
