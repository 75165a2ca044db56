"""`python -m benchmarks.claims`: write docs/claims.md from the files in docs/results."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from benchmarks.claims.claims import claims
from benchmarks.claims.results import ROOT, Results
from benchmarks.claims.row import COMMANDS, GAINS, STUDY, Claim

PAGE = ROOT / "docs" / "claims.md"
_HEAD = """# The paper's claims

Every claim of the [paper](../README.md), what was measured of it, and whether it
holds: {counts}. Body, motions and flesh are [synthetic](data.md), so a verdict is of the method,
not of people; it is a rule on the number (`benchmarks/claims/row.py`). ± is the standard
deviation over training seeds.

Rows with *standardised* and *faithful* are of the paper's whole pipeline at its size, from
aligner to decoder ([the two](../README.md#reproduce-it)). The others ask of the network alone, on
data that its aligner has not harmed: R² of offsets against the true ones, learned from principal
components of what the robust aligner gives, with rate and epoch chosen alike for all.
"""
_TAIL = """
Written by `python -m benchmarks.claims` from `docs/results/`, never by hand.
"""


def page(results: Results | None = None) -> str:
    """The page's text."""
    results = results or Results()
    found = claims(results)
    remarks = {
        STUDY: results.of_another_run(results.networks[0]),
        GAINS: results.of_another_run(results.alignment),
    }
    parts = [_HEAD.format(counts=counted(found))]
    for subject, rows in found.items():
        parts += [
            f"## {subject}\n",
            "| claim | place | measured | verdict | by |",
            "|---|---|---|---|---|",
        ]
        parts += [_row(row, remarks) for row in rows]
        parts.append("")
    parts += ["## Made by\n", "| results | command |", "|---|---|"]
    parts += [
        f"| [{name}]({source}) | `{command}` |" for source, (name, command) in COMMANDS.items()
    ]
    return "\n".join(parts) + "\n" + _TAIL


def counted(found: dict[str, list[Claim]]) -> str:
    """How many claims have which verdict."""
    counts = Counter(row.verdict for rows in found.values() for row in rows)
    words = {
        "holds": "{} hold",
        "in part": "{} in part",
        "does not hold here": "{} do not hold here",
        "needs the licensed data": "{} need the licensed data",
    }
    return ", ".join(said.format(counts[verdict]) for verdict, said in words.items())


def _row(row: Claim, remarks: Mapping[str, str]) -> str:
    by = ", ".join(
        f"[{COMMANDS[source][0]}]({source}){remarks.get(source, '')}" for source in row.sources
    )
    return f"| {row.claim} | {row.place} | {row.measured} | **{row.verdict}** | {by} |"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
