"""The report's pages: Markdown from a template, and one HTML file with its pictures inside."""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markdown_it import MarkdownIt

_ENVIRONMENT = Environment(
    loader=PackageLoader("bridge.report"),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
    # Markdown escapes for itself; the HTML page marks what comes rendered.
    autoescape=lambda name: bool(name and name.endswith(".html.j2")),
)


def _decimals(value: float | None, digits: int) -> str:
    # Adding 0 turns the negative zero of rounding into zero.
    return "-" if value is None else f"{round(value, digits) + 0.0:.{digits}f}"


def _exponent(value: float | None) -> str:
    return "-" if value is None else f"{value:.0e}" if value else "0"


_ENVIRONMENT.filters |= {"decimals": _decimals, "exponent": _exponent}


def render_markdown(context: Mapping[str, Any]) -> str:
    """`report.md` from the results."""
    return _ENVIRONMENT.get_template("report.md.j2").render(context)


def render_html(markdown: str, folder: Path, *, title: str, banner: str) -> str:
    """A page that needs no other file: pictures named in `markdown` are read from `folder`."""
    body = MarkdownIt("commonmark", {"html": False}).enable("table").render(markdown)
    body = re.sub(r'src="(figures/[\w.-]+\.png)"', lambda m: _data_uri(folder / m[1]), body)
    # A name that is a picture from elsewhere would have it fetched by whoever reads the page.
    body = re.sub(r'<img (?!src="data:)[^>]*>', "", body)
    # Tables scroll by themselves on a narrow screen, the page does not.
    body = body.replace("<table>", '<div class="wide"><table>').replace(
        "</table>", "</table></div>"
    )
    page = _ENVIRONMENT.get_template("page.html.j2")
    return page.render(title=title, banner=banner, body=body)


def _data_uri(path: Path) -> str:
    encoded = base64.b64encode(path.read_bytes()).decode("ascii")
    return f'src="data:image/png;base64,{encoded}"'
