"""`python -m benchmarks.claims`: write docs/results/claims.md from the files beside it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from benchmarks.claims.claims import claims
from benchmarks.claims.results import RESULTS, Results
from benchmarks.claims.row import COMMANDS, GAINS, PAPERS_STUDY, STUDY, Claim

PAGE = RESULTS / "claims.md"
_HEAD = """# The paper's claims

Each claim of the [paper](../../README.md) with what was measured of it and a verdict:
{counts}. All data are [synthetic](../data.md), so a verdict is of the method, not of real people.
A verdict is a rule on the number, written in `benchmarks/claims/`. ± is the standard deviation over
training seeds.

DSNet was measured in two settings; a claim whose verdicts differ between them counts as *in part*:

- *measured*: DSNet alone, on good data: it learns principal components of the robust aligner's
  offsets, with learning rate and epoch chosen on the validation clip, as for every network that
  it is compared with. R² is of the offsets, against the true ones;
- *on the paper's own ground*: the paper's aligner and autoencoder latents, Adam at 0.0001, nothing
  standardised, the last epoch. On the held-out jump R² is against the aligned offsets, as in the
  paper, elsewhere against the true ones. Rows with *standardised* and *faithful*
  ([what they are](../paper.md#the-papers-words-alone)) are of the whole pipeline at the paper's
  size.

A dash: not measured.
"""
_TAIL = """
Written by `python -m benchmarks.claims` from the files beside it.
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
