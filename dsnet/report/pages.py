"""The report's pages, in Markdown and HTML, of what `results.json` says."""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markdown_it import MarkdownIt

from bridge.motion.splits import CELLS
from dsnet.evaluation.pipelines import SMPL


def main_table(results: Mapping[str, Any]) -> str:
    """Each pipeline's predictors, and its own SMPL alone, in every test group; Markdown.

    A column has one reference: the mesh that was registered, of test motions the true one. What
    was trained from several seeds has its means, and the spread of R².
    """
    cells = {
        cell: title
        for cell, title in results["cell_titles"].items()
        if cell in ("validation", *CELLS)
        and any("mesh" in errors for errors in results["cells"][cell].values())
    }
    against = dict.fromkeys(CELLS, "true mesh") | {"validation": "registered mesh"}
    heads = [f"{title}, against the {against[cell]}" for cell, title in cells.items()]
    rows = ["| mean error, R² | " + " | ".join(heads) + " |", "|---" + "|---:" * len(cells) + "|"]
    for key, pipeline in results["pipelines"].items():
        own = {name: results["predictors"][name] for name in pipeline["predictors"]}
        own[smpl_of(results, key)] = f"*SMPL alone, as `{pipeline['aligner']}` fitted it*"
        for name, label in own.items():
            found = [_mm_and_r2(results, cell, name) for cell in cells]
            rows.append(f"| {label} | " + " | ".join(found) + " |")
    return "\n".join(rows)


def verdict_lines(results: Mapping[str, Any]) -> list[str]:
    """For each pipeline a sentence: in which test groups it does better than its SMPL alone."""
    lines = []
    for key, pipeline in results["pipelines"].items():
        name, smpl = pipeline["default"], smpl_of(results, key)
        better, worse = [], []
        for cell, title in results["cell_titles"].items():
            own, without = (of_mesh(results, cell, one, "mean_mm") for one in (name, smpl))
            if cell in ("validation", *CELLS) and own:
                less = own[0] < without[0]
                (better if less else worse).append(title)
        said = f"**{results['predictors'][name]}** is nearer to the mesh than SMPL alone in: "
        said += "; ".join(better) or "no test group"
        lines.append(f"{said}. Farther in: {'; '.join(worse)}." if worse else f"{said}.")
    return lines


def smpl_of(results: Mapping[str, Any], pipeline: str) -> str:
    """What SMPL alone is called in the motions of the pipeline of that name."""
    return own if (own := f"{SMPL}_{pipeline}") in results["predictors"] else SMPL


def of_mesh(results: Mapping[str, Any], cell: str, name: str, number: str) -> tuple[float, ...]:
    """A predictor's `mean_mm` or `r2` of the posed mesh in a test group; of what was trained from
    several seeds the mean and the standard deviation. Empty where it was not measured."""
    seeds = results["seeds"]["cells"] if results["seeds"] else {}
    if mesh := seeds.get(cell, {}).get(name, {}).get("mesh"):
        return mesh[number]["mean"], mesh[number]["sd"]
    mesh = results["cells"][cell].get(name, {}).get("mesh")
    return (mesh[number],) if mesh else ()


def plus_minus(values: Sequence[float]) -> str:
    """A number, or a mean and its spread."""
    return " ± ".join(_decimals(value, 2) for value in values)


def _mm_and_r2(results: Mapping[str, Any], cell: str, name: str) -> str:
    mm, r2 = (of_mesh(results, cell, name, number) for number in ("mean_mm", "r2"))
    return f"{plus_minus(mm[:1])} mm, {plus_minus(r2)}" if mm else "-"


def _decimals(value: float | None, digits: int) -> str:
    # Adding 0 turns the negative zero of rounding into zero.
    return "-" if value is None else f"{round(value, digits) + 0.0:.{digits}f}"


def _exponent(value: float | None) -> str:
    return "-" if value is None else f"{value:.0e}" if value else "0"


_ENVIRONMENT = Environment(
    loader=PackageLoader("dsnet.report"),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
    # Markdown escapes for itself; the HTML page marks what comes rendered.
    autoescape=lambda name: bool(name and name.endswith(".html.j2")),
)
_ENVIRONMENT.filters |= {"decimals": _decimals, "exponent": _exponent}


def render(template: str, **given: Any) -> str:
    """One of the templates with what it is given."""
    return _ENVIRONMENT.get_template(template).render(given)


def render_markdown(
    results: Mapping[str, Any], figures: Sequence[Any], departures: Sequence[str], notice: str
) -> str:
    """The page, with a line of links to its sections where the template says so."""
    shown = [results["predictors"][one["default"]] for one in results["pipelines"].values()]
    page = render(
        "report.md.j2",
        results=results,
        figures=[one for one in figures if one.name.startswith("figure")],
        more=[one for one in figures if not one.name.startswith("figure")],
        departures=departures,
        notice=notice,
        table=main_table(results),
        verdict=verdict_lines(results),
        shown=" and ".join(shown),
    )
    titles = re.findall(r"^## (.+)$", page, re.MULTILINE)
    links = " · ".join(f"[{title}](#{_anchor(title)})" for title in titles)
    return page.replace("[contents]", links, 1)


def _anchor(title: str) -> str:
    """As GitHub makes one of a heading."""
    return re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-")


def render_html(markdown: str, folder: Path, *, title: str, banner: str) -> str:
    """A page that needs no other file: pictures named in `markdown` are read from `folder`."""

    def picture(found: re.Match[str]) -> str:
        encoded = base64.b64encode((folder / found[1]).read_bytes()).decode("ascii")
        return f'src="data:image/png;base64,{encoded}"'

    body = MarkdownIt("commonmark", {"html": False}).enable("table").render(markdown)
    body = re.sub(r'src="(figures/[\w.-]+\.png)"', picture, body)
    # A name that is a picture from elsewhere would have it fetched by whoever reads the page.
    body = re.sub(r'<img (?!src="data:)[^>]*>', "", body)
    body = re.sub(r"<h2>(.*?)</h2>", lambda h: f'<h2 id="{_anchor(h[1])}">{h[1]}</h2>', body)
    # Of all HTML these alone are let through: what is behind a fold.
    body = re.sub(
        r"<p>&lt;details&gt;&lt;summary&gt;(.*?)&lt;/summary&gt;</p>",
        r"<details><summary>\1</summary>",
        body,
    ).replace("<p>&lt;/details&gt;</p>", "</details>")
    # Tables scroll by themselves on a narrow screen, the page does not.
    body = body.replace("<table>", '<div class="wide"><table>')
    body = body.replace("</table>", "</table></div>")
    return render("page.html.j2", title=title, banner=banner, body=body)
