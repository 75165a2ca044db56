"""Where measurements of a run lie: runs/<run>/bench/<name>.json."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bridge.runs import Run
from bridge.runs.files import write_text_atomically


def results_folder(run: str) -> Path:
    """The folder of a run's measurements."""
    return Run(run).path / "bench"


def write_results(run: str, name: str, results: Mapping[str, Any]) -> None:
    """Write what a benchmark measured."""
    folder = results_folder(run)
    folder.mkdir(parents=True, exist_ok=True)
    write_text_atomically(folder / f"{name}.json", json.dumps(results, indent=1) + "\n")
