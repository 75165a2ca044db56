"""What a stranger's names can do to a page: nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from bridge.report.page import render_html


@pytest.mark.parametrize(
    "name",
    [
        "<script>alert(1)</script>",
        "![x](http://a.example/c.png)",
        "![x](figures/../../x.png)",
        "[x](javascript:alert(1))",
        '"><img src=x onerror=alert(1)>',
    ],
)
def test_names_become_neither_scripts_nor_pictures_from_elsewhere(
    tmp_path: Path, name: str
) -> None:
    page = render_html(f"| a |\n|---|\n| {name} |\n", tmp_path, title=name, banner=name)
    for forbidden in ("<script>alert", "<img", 'href="javascript'):
        assert forbidden not in page
