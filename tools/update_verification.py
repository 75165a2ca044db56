"""Copy a finished `dsnet verify` into docs/results and say in docs/verification.md how it ended.

    python tools/update_verification.py [RUN]       after `dsnet verify --run RUN` (default: demo)

`tests/test_verification_page.py` compares the page with docs/results/verify.
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path
from typing import Any

from bridge.report.curves import draw_parity
from bridge.report.results import read_parity
from bridge.runs import Run

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "verification.md"
KEPT = ROOT / "docs" / "results" / "verify"
MARK = "<!-- outcome: written by tools/update_verification.py -->\n"


def main() -> None:
    """Refresh docs/results/verify and the page's block from runs/<run>/verify."""
    verified = Run(sys.argv[1] if len(sys.argv) > 1 else "demo").artifact("verify")
    shutil.rmtree(KEPT, ignore_errors=True)
    KEPT.mkdir(parents=True)
    for name in ("parity.json", "manifest.json"):
        shutil.copy2(verified.path / name, KEPT / name)
    draw_parity(KEPT / "parity.png", read_parity(verified), verified.origin)
    PAGE.write_text(with_outcome(PAGE.read_text(encoding="utf-8")), encoding="utf-8")


def load_parity() -> dict[str, Any]:
    """The committed results."""
    return json.loads((KEPT / "parity.json").read_text(encoding="utf-8"))


def with_outcome(page: str) -> str:
    """The page's text with its generated block written anew."""
    head, rest = page.split(MARK)
    return head + MARK + outcome() + rest[rest.index("<!-- end -->") :]


def outcome() -> str:
    """How many rows hold; which command made them, on what, in how long."""
    made = json.loads((KEPT / "manifest.json").read_text(encoding="utf-8"))["provenance"]
    rows = load_parity()["rows"]
    versions = ", ".join(f"{name} {v}" for name, v in made["versions"].items())
    return (
        f"{sum(row['passed'] for row in rows)} of {len(rows)} rows hold: "
        f"`{' '.join(made['command'])}`, {made['wall_time_s']:.0f} s on {made['machine']};\n"
        f"{versions}.\n"
    )


if __name__ == "__main__":
    main()
