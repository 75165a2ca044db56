"""Say in docs/reliability.md how the last fault tests ended.

    export DSNET_FAULTS_JSON=docs/results/reliability/faults.json
    DSNET_FAULTS_LONG=1 DSNET_FAULTS_KILLS=200 DSNET_FAULTS_FLIPS=500 \\
        python -m pytest -m faults tests/faults
    python -m tests.fuzz.campaign --inputs 10000 --json docs/results/reliability/fuzz.json
    python -m tests.fuzz.campaign --inputs 5000 --guided \\
        --json docs/results/reliability/fuzz_guided.json
    python tools/update_reliability.py

What measured `full_size.json` and `checksums.json` is in commit b9aa1159 and no longer in the
tree. `tests/test_reliability_page.py` compares the page with docs/results/reliability.
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


def main() -> None:
    """Refresh the page's block."""
    PAGE.write_text(with_counts(PAGE.read_text(encoding="utf-8")), encoding="utf-8")


def load(path: Path) -> dict[str, Any] | None:
    """Committed results; None if there are none."""
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else None


def with_counts(page: str) -> str:
    """The page's text with its generated block written anew."""
    head, rest = page.split(MARK)
    counts = [
        _faults(load(FAULTS)),
        _damaged(load(FUZZ), load(GUIDED)),
        _full_size(load(FULL_SIZE)),
        _cost(load(CHECKSUMS)),
    ]
    return head + MARK + "".join(counts) + rest[rest.index("<!-- end -->") :]


def _faults(faults: dict[str, Any] | None) -> str:
    if faults is None:
        return ""
    silent, tried = 0, 0
    for outcomes in faults["counts"].values():
        tried += sum(outcomes.values())
        silent += sum(times for outcome, times in outcomes.items() if "silent" in outcome)
    return (
        f"- [{tried} outcomes](results/reliability/faults.json) of the {faults['size']} suite, "
        f"{silent} of them silent.\n"
    )


def _damaged(*campaigns: dict[str, Any] | None) -> str:
    found = [
        counts for one in campaigns if one for counts in one.values() if isinstance(counts, dict)
    ]
    if not found:
        return ""
    total = {key: sum(counts[key] for counts in found) for key in ("inputs", "accepted", "other")}
    return (
        f"- {total['inputs']:,} damaged files, made [at random](results/reliability/fuzz.json) and "
        f"[by coverage](results/reliability/fuzz_guided.json): {total['accepted']:,} were harmless "
        f"and read, {total['other']} ended otherwise than in one line; "
        f"at most {max(counts['max_rss_mb'] for counts in found):,} MB of memory.\n"
    )


def _full_size(full_size: dict[str, Any] | None) -> str:
    if full_size is None:
        return ""
    stages = full_size["stages"].values()
    return (
        f"- A corpus of the paper's size ({full_size['sequences']} sequences, "
        f"{full_size['frames']:,} meshes; smooth functions in place of motions), each stage "
        "[killed twice](results/reliability/full_size.json) and called again: "
        f"{sum(len(one['differ']) for one in stages)} files differ in the end; at most "
        f"{max(one['anonymous_mb'] for one in stages):,.0f} MB that the system cannot take back.\n"
    )


def _cost(checksums: dict[str, Any] | None) -> str:
    if checksums is None:
        return ""
    return (
        f"- Digests and renames take {100 * checksums['share']:.1f} % "
        f"([measured](results/reliability/checksums.json)) of the time of run "
        f"`{checksums['run']}`.\n"
    )


if __name__ == "__main__":
    main()
