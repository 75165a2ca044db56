"""Copy a finished `dsnet verify` into docs/results and write its table into docs/verification.md.

    python tools/update_verification.py [RUN]       after `dsnet verify --run RUN` (default: demo)

`tests/test_verification_page.py` compares the page with docs/results/verify/parity.json.
"""

from __future__ import annotations

import json
import shutil
import sys
from itertools import groupby
from pathlib import Path
from typing import Any

from bridge.report.parity_figure import draw_parity
from bridge.report.summary import read_parity
from bridge.runs import Run

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "verification.md"
KEPT = ROOT / "docs" / "results" / "verify"
MARK = "<!-- table: written by tools/update_verification.py -->\n"
_SHORT = {"float64": "f64", "float32": "f32"}


def main() -> None:
    """Refresh docs/results/verify and the page's table from runs/<run>/verify."""
    verified = Run(sys.argv[1] if len(sys.argv) > 1 else "demo").artifact("verify")
    shutil.rmtree(KEPT, ignore_errors=True)
    KEPT.mkdir(parents=True)
    for name in ("parity.json", "manifest.json"):
        shutil.copy2(verified.path / name, KEPT / name)
    draw_parity(KEPT / "parity.png", read_parity(verified), verified.origin)
    PAGE.write_text(with_table(PAGE.read_text(encoding="utf-8")), encoding="utf-8")


def load_parity() -> dict[str, Any]:
    """The committed results."""
    return json.loads((KEPT / "parity.json").read_text(encoding="utf-8"))


def with_table(page: str) -> str:
    """The page's text with its generated block written anew."""
    provenance = json.loads((KEPT / "manifest.json").read_text(encoding="utf-8"))["provenance"]
    head, rest = page.split(MARK)
    block = origin(provenance) + table(load_parity())
    return head + MARK + block + rest[rest.index("<!-- end -->") :]


def origin(provenance: dict[str, Any]) -> str:
    """Which command made the numbers, on what, in how long."""
    versions = ", ".join(f"{name} {v}" for name, v in provenance["versions"].items())
    return (
        f"`{' '.join(provenance['command'])}`: {provenance['wall_time_s']:.0f} s on "
        f"{provenance['machine']};\n{versions}.\n\n"
    )


def table(parity: dict[str, Any]) -> str:
    """One line a check and part: the largest relative difference of each engine and precision."""
    rows = parity["rows"]
    columns = list(dict.fromkeys((row["engine"], row["dtype"]) for row in rows))
    titles = [f"{engine} {_SHORT[dtype]}" for engine, dtype in columns]
    lines = [
        f"{sum(row['passed'] for row in rows)} of {len(rows)} rows hold.\n",
        f"| check | part | {' | '.join(titles)} |",
        f"|---|---|{'---:|' * len(columns)}",
    ]
    place = {key: k for k, key in enumerate(dict.fromkeys(map(_line_of, rows)))}
    for (check, part), line in groupby(sorted(rows, key=lambda r: place[_line_of(r)]), _line_of):
        found = {(row["engine"], row["dtype"]): row for row in line}
        cells = [_cell(found.get(column)) for column in columns]
        lines.append(f"| {check} | {part} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _line_of(row: dict[str, Any]) -> tuple[str, str]:
    return row["check"], row["part"]


def _cell(row: dict[str, Any] | None) -> str:
    if row is None:
        return ""
    value = "no result" if row["max_rel"] is None else f"{row['max_rel']:.0e}"
    value = "0" if row["max_rel"] == 0 else value
    return value if row["passed"] else f"**{value}**"


if __name__ == "__main__":
    main()
