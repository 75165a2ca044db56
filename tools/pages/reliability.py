"""docs/results/reliability/reliability.md: how the last fault tests ended."""

from __future__ import annotations

from collections import Counter

from tools.pages.blocks import load


def damaged(name: str) -> list[dict[str, int]]:
    """What came of damaged files, a reader each."""
    return [one for one in load(f"reliability/{name}").values() if isinstance(one, dict)]


_MADE = """
```
export DSNET_FAULTS_JSON=docs/results/reliability/faults.json    # without these: a short suite
DSNET_FAULTS_LONG=1 DSNET_FAULTS_KILLS=200 DSNET_FAULTS_FLIPS=500 \\
    python -m pytest -m faults tests/faults
python -m tests.fuzz.campaign --inputs 10000 --json docs/results/reliability/fuzz.json
python -m tests.fuzz.campaign --inputs 5000 --guided \\
    --json docs/results/reliability/fuzz_guided.json
python -m tools.update_pages reliability
```

What measured `full_size.json` and `checksums.json` is in commit `b9aa1159` and no longer in the
tree.
"""


def page() -> str:
    """A line for each kind of test, and the commands."""
    faults, full_size, checksums = (
        load(f"reliability/{name}") for name in ("faults", "full_size", "checksums")
    )
    outcomes, stages = Counter(), full_size["stages"].values()
    for one in faults["counts"].values():
        outcomes.update(one)
    silent = sum(times for outcome, times in outcomes.items() if "silent" in outcome)
    found = [*damaged("fuzz"), *damaged("fuzz_guided")]
    total = {key: sum(one[key] for one in found) for key in ("inputs", "accepted", "other")}
    return (
        "# Reliability: how the tests ended\n\n[What they promise](../../reliability.md).\n\n"
        f"- [{outcomes.total()} outcomes](faults.json) of the "
        f"{faults['size']} suite, {silent} of them silent.\n"
        f"- {total['inputs']:,} damaged files, made [at random](fuzz.json) and "
        f"[by coverage](fuzz_guided.json): {total['accepted']:,} were harmless "
        f"and read, {total['other']} ended otherwise than in one line; "
        f"at most {max(one['max_rss_mb'] for one in found):,} MB of memory.\n"
        f"- A corpus of the paper's size ({full_size['sequences']} sequences, "
        f"{full_size['frames']:,} meshes; smooth functions in place of motions), each stage "
        "[killed twice](full_size.json) and called again: "
        f"{sum(len(one['differ']) for one in stages)} files differ in the end; at most "
        f"{max(one['anonymous_mb'] for one in stages):,.0f} MB that the system cannot take back.\n"
        f"- Digests and renames take {100 * checksums['share']:.1f} % "
        "([measured](checksums.json)) of the time of run "
        f"`{checksums['run']}`.\n{_MADE}"
    )
