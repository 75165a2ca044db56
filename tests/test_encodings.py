"""No text file depends on the locale."""

from __future__ import annotations

import ast

from tests.sources import PACKAGES, parsed, source_files


def opens_text(call: ast.Call) -> bool:
    """Whether a call reads or writes text, by its name and mode."""
    if isinstance(call.func, ast.Name) and call.func.id == "open":
        mode = call.args[1] if len(call.args) > 1 else ast.Constant("r")
        return not isinstance(mode, ast.Constant) or "b" not in str(mode.value)
    if "metadata" in ast.unparse(call.func):  # of a distribution, always UTF-8
        return False
    return getattr(call.func, "attr", "") in ("read_text", "write_text")


def test_no_text_file_depends_on_the_locale():
    """What is read or written is UTF-8 on every system."""
    found = [
        f"{path}:{call.lineno}"
        for path in source_files(*PACKAGES, "benchmarks", "examples", "tools")
        for call in ast.walk(parsed(path))
        if isinstance(call, ast.Call)
        and opens_text(call)
        and "encoding" not in {keyword.arg for keyword in call.keywords}
    ]
    assert not found
