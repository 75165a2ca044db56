"""Write generated tables into the pages of docs/ that quote them.

    python tools/include_results.py

Between `<!-- include: FILE -->` and `<!-- end -->` a page holds the text of docs/FILE, which a
command of the tree wrote, without its title; `tests/test_readme.py` compares them.
"""

from __future__ import annotations

import re
from pathlib import Path

DOCS = Path(__file__).parents[1] / "docs"
_BLOCK = re.compile(r"(<!-- include: (?P<file>\S+) -->\n).*?(?=<!-- end -->)", re.DOTALL)


def main() -> None:
    """Refresh every page."""
    for page in sorted(DOCS.glob("*.md")):
        page.write_text(with_included(page.read_text()))


def with_included(page: str) -> str:
    """The page's text with every quoted file written anew."""
    return _BLOCK.sub(lambda block: block[1] + _body(DOCS / block["file"]), page)


def _body(path: Path) -> str:
    return re.sub(r"\A# .*\n\n", "", path.read_text())


if __name__ == "__main__":
    main()
