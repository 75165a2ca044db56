"""Longer trainings beside shorter ones: which rows are shown, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks.subspaces.lengths import LengthsConfig, main, markdown
from benchmarks.subspaces.results import SUMMARY
from bridge.errors import DsnetError

RESULTS = Path(__file__).parents[2] / "docs" / "results" / "subspaces"
SETTINGS = {"run": "r", "data": "synthetic", "seed": 0, "split": "frame", "steps": 10,
            "search_steps": 2, "validate_every": 5, "validation_frames": 256}  # fmt: skip
ERRORS = {"r2": 0.9, "mean_mm": 0.1, "p95_mm": 0.2, "max_mm": 0.3}


def row(code: str, size: int, steps: int | None) -> dict[str, Any]:
    found: dict[str, Any] = {
        "code": code, "label": code.upper(), "size": size, "parameters": 1234,
        "validation": ERRORS, "held_out": None, "provenance": {"command": ["dsnet", "--made"]},
    }  # fmt: skip
    if steps is None:
        return {**found, "scored_r2": 0.97}
    curve = {"steps": [0, steps // 2, steps], "r2": [0.5, 0.96, 0.95]}
    return {**found, "curve": curve, "steps_taken": steps, "learning_rate": 1e-4}


def folder_of(path: Path, rows: list[dict[str, Any]], **settings: Any) -> Path:
    path.mkdir()
    names = [f"{one['code']}-{one['size']}-0.json" for one in rows]
    for name, one in zip(names, rows, strict=True):
        (path / name).write_text(json.dumps(one))
    (path / SUMMARY).write_text(json.dumps({"settings": {**SETTINGS, **settings}, "rows": names}))
    return path


def test_rows_of_the_papers_size_by_code_and_length(tmp_path):
    short = folder_of(tmp_path / "a", [row("pca", 100, None), row("mesh", 25, 10),
                                       row("mesh", 100, 10), row("residual", 100, 10)])  # fmt: skip
    longer = folder_of(tmp_path / "b", [row("mesh", 100, 40)], steps=40, validate_every=20)
    main(LengthsConfig(tmp_path / "page.md", (short, longer)))
    page = (tmp_path / "page.md").read_text()
    assert [line for line in page.splitlines() if line.startswith("| ")][1:] == [
        "| PCA | 100 | 1,234 |  |  |  | 0.9700 | 0.9000 | 0.10 / 0.20 / 0.30 |  |  |",
        *(
            f"| {code} | 100 | 1,234 | {steps} | 0.0001 | 0.5000 | 0.9600 | 0.9000 "
            "| 0.10 / 0.20 / 0.30 |  |  |"
            for code, steps in (("MESH", 10), ("MESH", 40), ("RESIDUAL", 10))
        ),
    ]
    assert "synthetic" in page.splitlines()[0]
    assert (tmp_path / "page.png").stat().st_size > 10_000


def test_folders_that_differ_in_more_are_refused(tmp_path):
    short = folder_of(tmp_path / "a", [row("pca", 100, None)])
    other = folder_of(tmp_path / "b", [row("mesh", 100, 40)], steps=40, seed=1)
    page = tmp_path / "page.md"
    for folders, message in (
        ((short, other), r"b with seed 1; expected seed 0, as .*a has"),
        ((short, tmp_path / "c"), "c without subspaces.json"),
        ((), "no --folders"),
    ):
        with pytest.raises(DsnetError, match=message):
            main(LengthsConfig(page, folders))
        assert not page.exists()


def test_the_committed_page_is_made_of_the_committed_rows(monkeypatch):
    monkeypatch.chdir(RESULTS.parents[2])
    name = "docs/results/subspaces"
    folders = [Path(name), Path(name) / "steps_1380"]
    page = (RESULTS / "lengths.md").read_text()
    assert page == markdown(Path(f"{name}/lengths.md"), folders)
