"""Write the counts of the last fault tests into docs/reliability.md.

    export DSNET_FAULTS_JSON=docs/results/reliability/faults.json
    DSNET_FAULTS_LONG=1 DSNET_FAULTS_KILLS=200 DSNET_FAULTS_FLIPS=500 \\
        python -m pytest -m faults tests/faults
    python -m tests.fuzz.campaign --inputs 10000 --json docs/results/reliability/fuzz.json
    python -m tests.fuzz.campaign --inputs 5000 --guided \\
        --json docs/results/reliability/fuzz_guided.json
    python -m benchmarks.full_size
    python -m benchmarks.checksums --run demo
    python tools/update_reliability.py

`tests/test_reliability_page.py` compares the page with docs/results/reliability.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "reliability.md"
KEPT = ROOT / "docs" / "results" / "reliability"
FAULTS, FUZZ, GUIDED, FULL_SIZE, CHECKSUMS = (
    KEPT / f"{name}.json" for name in ("faults", "fuzz", "fuzz_guided", "full_size", "checksums")
)
MARK = "<!-- counts: written by tools/update_reliability.py -->\n"
_NAMES = {
    "kill": "killed, interrupted, terminated",
    "rot": "one byte changed",
    "disk": "full and read-only disks",
    "processes": "processes",
    "report": "reports",
}


def main() -> None:
    """Refresh the page's block."""
    PAGE.write_text(with_counts(PAGE.read_text(encoding="utf-8")), encoding="utf-8")


def load(path: Path) -> dict[str, Any] | None:
    """Committed results; None if there are none."""
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else None


def with_counts(page: str) -> str:
    """The page's text with its generated block written anew."""
    head, rest = page.split(MARK)
    blocks = [
        _counts(load(FAULTS)),
        _damaged(load(FUZZ)),
        _damaged(load(GUIDED)),
        _full_size(load(FULL_SIZE)),
        _cost(load(CHECKSUMS)),
    ]
    return head + MARK + "".join(blocks) + rest[rest.index("<!-- end -->") :]


def _counts(faults: dict[str, Any] | None) -> str:
    if faults is None:
        return "Not counted yet.\n"
    lines = [
        f"The {faults['size']} suite, seed {faults['seed']}, on {faults['machine']}.\n",
        "| fault | outcome | times |",
        "|---|---|---:|",
    ]
    for fault, outcomes in faults["counts"].items():
        for outcome, times in outcomes.items():
            lines.append(f"| {_NAMES[fault]} | {outcome} | {times} |")
    return "\n".join(lines) + "\n"


def _damaged(fuzz: dict[str, Any] | None) -> str:
    if fuzz is None:
        return ""
    readers = {name: counts for name, counts in fuzz.items() if isinstance(counts, dict)}
    tried = sum(counts["inputs"] for counts in readers.values())
    lines = [
        f"\n{tried:,} damaged files, by `{fuzz['command']}`:\n",
        "| reader | inputs | refused in one line | accepted | anything else | most memory [MB] |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    columns = ("inputs", "refused", "accepted", "other", "max_rss_mb")
    for name, counts in readers.items():
        lines.append(f"| `{name}` | {' | '.join(f'{counts[key]:,}' for key in columns)} |")
    return "\n".join(lines) + "\n"


def _full_size(full_size: dict[str, Any] | None) -> str:
    if full_size is None:
        return ""
    lines = [
        f"\nA corpus of the paper's size, {full_size['sequences']} sequences of "
        f"{full_size['frames']:,} meshes (smooth functions in place of motions and tissue), as "
        "little training as a stage allows, each stage killed twice and called again, by "
        f"`{full_size['command']}` on {full_size['machine']}. Anonymous memory cannot be taken "
        "back by the system; pages of mapped files can.\n",
        "| stage | anonymous memory [MB] | with mapped files [MB] | killed after that part of its "
        "time | files that differ in the end |",
        "|---|---:|---:|---|---:|",
    ]
    for stage, one in full_size["stages"].items():
        memory = [f"{one[key]:,.0f}" for key in ("anonymous_mb", "resident_mb")]
        kills = [f"{k['after_s'] / one['wall_s']:.0%} ({k['found']})" for k in one["kills"]]
        cells = [*memory, ", ".join(kills), str(len(one["differ"]))]
        lines.append(f"| `{stage}` | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _cost(checksums: dict[str, Any] | None) -> str:
    if checksums is None:
        return ""
    return (
        f"\nDigests of run `{checksums['run']}` and the rename of its stages into place: "
        f"{checksums['seconds']:.1f} s of {checksums['stages_s']:.0f} s that the stages took, "
        f"{100 * checksums['share']:.1f} %, on {checksums['machine']}.\n"
    )


if __name__ == "__main__":
    main()
