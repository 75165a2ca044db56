"""What all blocks share: committed results, tables, and a block's place in its page."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from bridge.errors import DsnetError
from bridge.runs import Run

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "docs" / "results"


def load(name: str) -> dict[str, Any]:
    """A committed JSON file, by its path below docs/results without its ending."""
    return json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))


def folder_of(run: Run, name: str) -> Path:
    """A folder of a finished run, which is there."""
    folder = run.path / name
    if not folder.is_dir():
        raise DsnetError(
            f"no folder {folder}", f"a run that has {name}/", "Make it, or check the run's name."
        )
    return folder


def replaced(page: str, name: str, text: str) -> str:
    """A page with another text from `<!-- NAME ... -->` to the next `<!-- end ... -->`."""
    block = rf"(<!-- {name}\b[^>]*-->\n).*?(?=<!-- end\b)"
    page, count = re.subn(block, lambda found: found[1] + text, page, flags=re.DOTALL)
    if count != 1:
        raise ValueError(f"{count} blocks `{name}` in a page; expected one")
    return page


def table(head: str, rows: Iterable[Iterable[Any]]) -> str:
    """In Markdown, all but the first column to the right; ` | ` divides the head's columns."""
    ruler = " | ".join(["---", *["---:"] * head.count(" | ")])
    lines = [head, ruler, *(" | ".join(map(str, row)) for row in rows)]
    return "".join(f"| {line} |\n" for line in lines)
