"""Write generated tables into the pages that quote them.

    python tools/include_results.py

Between `<!-- include: FILE -->` and `<!-- end -->` a page holds the first table of FILE, which a
command of the tree wrote; `tests/test_readme.py` compares them.
"""

from __future__ import annotations

import re
from itertools import takewhile
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
_BLOCK = re.compile(r"(<!-- include: (?P<file>\S+) -->\n).*?(?=<!-- end -->)", re.DOTALL)


def main() -> None:
    """Refresh every page."""
    for page in PAGES:
        page.write_text(with_included(page.read_text(encoding="utf-8")), encoding="utf-8")


def with_included(page: str) -> str:
    """The page's text with every quoted file written anew."""
    return _BLOCK.sub(lambda block: block[1] + _table(ROOT / block["file"]), page)


def _table(path: Path) -> str:
    lines = path.read_text(encoding="utf-8").splitlines()
    first = next(index for index, line in enumerate(lines) if line.startswith("|"))
    rows = takewhile(lambda line: line.startswith("|"), lines[first:])
    return "\n".join(rows) + "\n"


if __name__ == "__main__":
    main()
