"""docs/reliability.md: how the last fault tests ended.

    export DSNET_FAULTS_JSON=docs/results/reliability/faults.json
    DSNET_FAULTS_LONG=1 DSNET_FAULTS_KILLS=200 DSNET_FAULTS_FLIPS=500 \\
        python -m pytest -m faults tests/faults
    python -m tests.fuzz.campaign --inputs 10000 --json docs/results/reliability/fuzz.json
    python -m tests.fuzz.campaign --inputs 5000 --guided \\
        --json docs/results/reliability/fuzz_guided.json

What measured `full_size.json` and `checksums.json` is in commit b9aa1159 and no longer in the tree.
"""

from __future__ import annotations

from collections import Counter

from tools.pages.blocks import load


def damaged(name: str) -> list[dict[str, int]]:
    """What came of damaged files, a reader each."""
    return [one for one in load(f"reliability/{name}").values() if isinstance(one, dict)]


def counts() -> str:
    """A line for each kind of test."""
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
        f"- [{outcomes.total()} outcomes](results/reliability/faults.json) of the "
        f"{faults['size']} suite, {silent} of them silent.\n"
        f"- {total['inputs']:,} damaged files, made [at random](results/reliability/fuzz.json) and "
        f"[by coverage](results/reliability/fuzz_guided.json): {total['accepted']:,} were harmless "
        f"and read, {total['other']} ended otherwise than in one line; "
        f"at most {max(one['max_rss_mb'] for one in found):,} MB of memory.\n"
        f"- A corpus of the paper's size ({full_size['sequences']} sequences, "
        f"{full_size['frames']:,} meshes; smooth functions in place of motions), each stage "
        "[killed twice](results/reliability/full_size.json) and called again: "
        f"{sum(len(one['differ']) for one in stages)} files differ in the end; at most "
        f"{max(one['anonymous_mb'] for one in stages):,.0f} MB that the system cannot take back.\n"
        f"- Digests and renames take {100 * checksums['share']:.1f} % "
        "([measured](results/reliability/checksums.json)) of the time of run "
        f"`{checksums['run']}`.\n"
    )
