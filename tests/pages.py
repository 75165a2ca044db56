"""The pages, and the commands that stand on them."""

from __future__ import annotations

import re
from pathlib import Path
from textwrap import dedent

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    path.relative_to(ROOT).as_posix()
    for path in (ROOT / "README.md", *(ROOT / "docs").glob("*.md"))
)


def commands_on(page: str) -> list[str]:
    """Lines of code blocks, and code in the text, without comments."""
    text = (ROOT / page).read_text(encoding="utf-8")
    blocks = "\n".join(re.findall(r"```\w*\n(.*?)```", text, re.S)).replace("\\\n", " ")
    inline = re.findall(r"`([^`]+)`", re.sub(r"```.*?```", "", text, flags=re.S))
    lines = [*blocks.splitlines(), *(" ".join(code.split()) for code in inline)]
    return [line.partition("  #")[0] for line in lines]


def flags_of(command: str) -> set[str]:
    """The long options in a command or in its help."""
    return set(re.findall(r"(?<=\s)(--[a-z][\w.-]*)", command))


def python_blocks(page: str) -> list[str]:
    """The Python in a page, each block as a file would hold it."""
    text = (ROOT / page).read_text(encoding="utf-8")
    found = re.findall(r"^( *)```python\n(.*?)^ *```$", text, re.DOTALL | re.MULTILINE)
    return [dedent(block) for _, block in found]
