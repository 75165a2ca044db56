"""What the table of claims reads: results files under docs/results, and of which data they are."""

from __future__ import annotations

import json
from collections.abc import Iterable
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from bridge.motion.splits import CELLS

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "docs" / "results"
KNOWN, UNSEEN, NEW, NEW_UNSEEN = (
    "known_person_known_motion",
    "known_person_unseen_motion",
    "new_person_known_motion",
    "new_person_unseen_motion",
)
HELD_OUT = "validation"
"""The paper's own clip, judged against its aligned offsets."""
assert set(CELLS) == {KNOWN, UNSEEN, NEW, NEW_UNSEEN}


class Results:
    """Files below a folder of results, read when they are asked for."""

    def __init__(self, folder: Path = RESULTS) -> None:
        self.folder = folder

    def read(self, name: str) -> dict[str, Any]:
        """One JSON file."""
        return json.loads((self.folder / name).read_text(encoding="utf-8"))

    def read_if_there(self, name: str) -> dict[str, Any] | None:
        """One JSON file, or None."""
        return self.read(name) if (self.folder / name).exists() else None

    def seeds(self, pattern: str) -> list[dict[str, Any]]:
        """All JSON files of a name, by seed."""
        files = sorted(self.folder.glob(pattern))
        return [json.loads(path.read_text(encoding="utf-8")) for path in files]

    @cached_property
    def demo(self) -> dict[str, Any]:
        """The run of `./reproduce.sh`."""
        return self.read("demo/results.json")

    @cached_property
    def paper(self) -> dict[str, Any]:
        """The run at the paper's size."""
        return self.read("paper/results.json")

    @cached_property
    def networks(self) -> list[dict[str, Any]]:
        """The study of networks, a seed each, on the robust aligner's offsets."""
        return self.seeds("claims/align_robust-?.json")

    @cached_property
    def papers_networks(self) -> list[dict[str, Any]]:
        """The same on the paper's own ground."""
        return self.seeds("claims/paper-?.json")

    @cached_property
    def batch_norm(self) -> dict[str, Any] | None:
        """What batch normalisation gives, once it was measured."""
        return self.read_if_there("claims/batch_norm.json")

    @cached_property
    def seconds(self) -> dict[str, Any] | None:
        """DSNet and a SoftSMPL-like network, once they were timed."""
        return self.read_if_there("claims/seconds.json")

    @cached_property
    def alignment(self) -> dict[str, Any]:
        """The study of alignment and gains."""
        return self.read("claims/alignment.json")

    @cached_property
    def comparison(self) -> list[dict[str, Any]]:
        """Every system side by side, law `own`."""
        return self.seeds("comparison/own-?.json")

    def of_another_run(self, study: dict[str, Any]) -> str:
        """A remark where a study's true offsets are not those of the run that is shown."""
        now_mm = self.demo["cells"][KNOWN]["smpl"]["offsets"]["rms_mm"]
        return "" if abs(study["true_mm"] / now_mm - 1) < 1e-3 else " *(data of an earlier run)*"


def mean_sd(values: Iterable[float], digits: int = 2) -> str:
    """Mean, and the spread over seeds where there are several."""
    array = np.array(list(values))
    # Adding 0 turns the negative zero of rounding into zero.
    mean = f"{round(array.mean(), digits) + 0.0:.{digits}f}"
    return mean if len(array) < 2 else f"{mean} ± {array.std(ddof=1):.{digits}f}"


def r2_of(scores: Iterable[dict[str, Any]], system: str, cell: str) -> list[float]:
    """Of each seed that has the system."""
    return [one["systems"][system]["r2"][cell] for one in scores if system in one["systems"]]
