"""Write what README and docs/ say of the files in docs/results: blocks, and some whole pages.

    python -m tools.update_pages [NAME ...]                    all of them, or those pages
    python -m tools.update_pages readme claims --run demo      after `./reproduce.sh`
    python -m tools.update_pages speed --run demo              after `python -m benchmarks.speed`
    python -m tools.update_pages verification --run demo       after `dsnet verify`

With `--run`, what the run has of the page is first copied into docs/results. A block is what stands
between `<!-- NAME: written by tools/update_pages.py -->` and `<!-- end -->`; `tests/test_pages.py`
compares all with docs/results.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path

from benchmarks.claims.__main__ import page as claims_page
from benchmarks.real_motions import markdown as real_table
from bridge.runs import Run
from tools.pages import markers, paper, readme, reliability, scaling, speed, verification
from tools.pages.blocks import RESULTS, ROOT, replaced

Text = Callable[[], str]
WRITTEN: Mapping[str, Text | Mapping[str, Text]] = {
    "README.md": {"verdict": readme.verdict, "times": readme.times},
    "dsnet/prediction/packaged/MODEL_CARD.md": {"card": readme.card},
    "docs/results/claims.md": claims_page,
    "docs/markers.md": {
        "fitted": markers.fitted,
        "numbers": markers.numbers,
        "recovery": markers.recovery,
    },
    "docs/motion_files.md": {"many": scaling.many_motions},
    "docs/verification.md": {"outcome": verification.outcome},
    "docs/results/alignment/readings.md": paper.readings,
    "docs/results/demo/speed.md": speed.page,
    "docs/results/departures.md": paper.departures,
    "docs/results/motion_kinds.md": {
        "real": lambda: real_table(RESULTS / "real_motions.json") + "\n",
    },
    "docs/results/reliability/reliability.md": reliability.page,
    "docs/results/scaling/scaling.md": scaling.page,
}
"""The text of a page, or of its blocks."""
PAGES = {Path(page).stem.lower(): page for page in WRITTEN}
TAKEN: Mapping[str, Callable[..., None]] = {
    "readme": readme.take_report,
    "speed": speed.take_bench,
    "verification": verification.take_verification,
}


def main() -> None:
    """Do what the command line says."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(PAGES))
    parser.add_argument("--run", help=f"copy from this run first: {', '.join(TAKEN)}")
    parser.add_argument(
        "--busy", action="store_true", help="README: the machine had other work too"
    )
    asked = parser.parse_args()
    if unknown := {*asked.names} - {*PAGES}:
        parser.error(f"no page {', '.join(sorted(unknown))}; expected {', '.join(PAGES)}")
    if asked.run and not {*asked.names} & {*TAKEN}:
        parser.error(f"--run is for {', '.join(TAKEN)}: name what to copy")
    for name in asked.names if asked.run else ():
        if name in TAKEN:
            options = {"busy": True} if asked.busy and name == "readme" else {}
            TAKEN[name](Run(asked.run), **options)
    for name in asked.names or PAGES:
        (ROOT / PAGES[name]).write_text(written(PAGES[name]), encoding="utf-8")


def written(page: str) -> str:
    """A page as the results have it: all of it, or with its blocks written anew."""
    made = WRITTEN[page]
    if callable(made):
        return made()
    text = (ROOT / page).read_text(encoding="utf-8")
    for name, block in made.items():
        text = replaced(text, name, block())
    return text


if __name__ == "__main__":
    main()
