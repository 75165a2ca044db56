"""`python -m benchmarks.claims`: write docs/claims.md from the files in docs/results."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from benchmarks.claims.claims import claims
from benchmarks.claims.results import ROOT, Results
from benchmarks.claims.row import COMMANDS, GAINS, PAPERS_STUDY, STUDY, Claim

PAGE = ROOT / "docs" / "claims.md"
_HEAD = """# The paper's claims

Every claim of the [paper](../README.md), what was measured of it, and whether it
holds: {counts}. Body, motions and flesh are [synthetic](data.md), so a verdict is of the method,
not of people; it is a rule on the number (`benchmarks/claims/row.py`). ± is the standard
deviation over training seeds.

Of the network two grounds are asked, and where they differ the claim counts as in part:

- *measured*: the network alone, on data that the paper's aligner has not harmed: R² of offsets
  against the true ones, learned from principal components of what the robust aligner gives, with
  rate and epoch chosen alike for all;
- *on the paper's own ground*: its aligner, its autoencoder's latents, Adam's rate 0.0001, nothing
  scaled, the last epoch (rivals learn these latents as they do on the other ground); on the
  held-out jump R² is of the aligned offsets, as the paper has it, elsewhere of the true ones; a
  dash where nothing was measured. Rows with *standardised* and *faithful* are of the
  whole pipeline at the paper's size, aligner to decoder ([the two](../README.md#reproduce-it)).
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
    if results.papers_networks:
        remarks[PAPERS_STUDY] = results.of_another_run(results.papers_networks[0])
    parts = [_HEAD.format(counts=counted(found))]
    for subject, rows in found.items():
        parts += [f"## {subject}\n", *_table(rows, remarks), ""]
    used = {source for rows in found.values() for row in rows for source in row.sources}
    parts += ["## Made by\n", "| results | command |", "|---|---|"]
    parts += [
        f"| [{name}]({source}) | `{command}` |"
        for source, (name, command) in COMMANDS.items()
        if source in used
    ]
    return "\n".join(parts) + "\n" + _TAIL


def counted(found: dict[str, list[Claim]]) -> str:
    """How many claims have which verdict."""
    counts = Counter(row.counted_as for rows in found.values() for row in rows)
    words = {
        "holds": "{} hold",
        "in part": "{} in part",
        "does not hold here": "{} do not hold here",
        "needs the licensed data": "{} need the licensed data",
    }
    return ", ".join(said.format(counts[verdict]) for verdict, said in words.items())


def _table(rows: Sequence[Claim], remarks: Mapping[str, str]) -> list[str]:
    """With a column of the paper's own ground where a row was measured there."""
    there = any(row.on_papers_ground for row in rows)
    heads = ["claim", "place", "measured", *["on the paper's own ground"] * there, "verdict", "by"]
    table = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for row in rows:
        by = ", ".join(
            f"[{COMMANDS[source][0]}]({source}){remarks.get(source, '')}" for source in row.sources
        )
        measured = [row.measured, *[row.on_papers_ground] * there]
        cells = [text or "—" for text in measured]
        cells = [row.claim, row.place, *cells, f"**{row.said}**", by]
        table.append(f"| {' | '.join(cells)} |")
    return table


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
