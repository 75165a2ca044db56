"""Render the report from `results.json`, in Markdown and HTML."""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from markdown_it import MarkdownIt

from bridge.motion.splits import CELLS
from dsnet.evaluation.pipelines import SMPL
from dsnet.pictures.page_templates import decimals, fill_template

_NEARER, _FARTHER = "✓", "✗"


def verdict_table(results: Mapping[str, Any]) -> str:
    """A Markdown table: a row for each predictor and for SMPL alone, a column for each test group.

    A tick where the predictor is nearer to the mesh than SMPL alone, a cross where it is farther;
    R² and the mean error. A predictor trained from several seeds shows its mean, and the spread of
    R².
    """
    groups = {
        group: title
        for group, title in results["cell_titles"].items()
        if group in ("validation", *CELLS)
        and any("mesh" in errors for errors in results["cells"][group].values())
    }
    rows = ["| | " + " | ".join(groups.values()) + " |", "|---" + "|---:" * len(groups) + "|"]
    for key, pipeline in results["pipelines"].items():
        smpl = smpl_name(results, key)
        labels = {name: results["predictors"][name] for name in pipeline["predictors"]}
        labels[smpl] = f"*SMPL alone, as `{pipeline['aligner']}` fitted it*"
        for name, label in labels.items():
            cells = [_verdict(results, group, name, smpl) for group in groups]
            rows.append(f"| {label} | " + " | ".join(cells) + " |")
    return "\n".join(rows)


def _verdict(results: Mapping[str, Any], group: str, name: str, smpl: str) -> str:
    """One cell of the table; `smpl` is the name of SMPL alone."""
    error, without = (mesh_score(results, group, one, "mean_mm") for one in (name, smpl))
    if not error:
        return "-"
    mm = f"{plus_minus(error[:1])} mm"
    if name == smpl:
        return mm
    mark = _NEARER if error[0] < without[0] else _FARTHER
    return f"{mark} {plus_minus(mesh_score(results, group, name, 'r2'))}, {mm}"


def smpl_name(results: Mapping[str, Any], pipeline: str) -> str:
    """The name in `results["predictors"]` of SMPL alone, with the motions of a pipeline."""
    named = f"{SMPL}_{pipeline}"
    return named if named in results["predictors"] else SMPL


def mesh_score(results: Mapping[str, Any], group: str, name: str, score: str) -> tuple[float, ...]:
    """A predictor's `mean_mm` or `r2` of the posed mesh in a test group.

    Mean and standard deviation if it was trained from several seeds; empty if not measured.
    """
    seeds = results["seeds"]["cells"] if results["seeds"] else {}
    if mesh := seeds.get(group, {}).get(name, {}).get("mesh"):
        return mesh[score]["mean"], mesh[score]["sd"]
    mesh = results["cells"][group].get(name, {}).get("mesh")
    return (mesh[score],) if mesh else ()


def plus_minus(values: Sequence[float]) -> str:
    """A number with two decimals, or a mean and its standard deviation with ± between."""
    return " ± ".join(decimals(value, 2) for value in values)


def render_markdown(
    results: Mapping[str, Any],
    figures: Sequence[Any],
    departures: Sequence[str],
    videos: Sequence[str] = (),
) -> str:
    """The report in Markdown; links to its sections replace the template's `[contents]`.

    `videos` are the names of figures that lie in `videos/` as well.
    """
    shown = [results["predictors"][one["default"]] for one in results["pipelines"].values()]
    page = fill_template(
        "report.md.j2",
        results=results,
        figures=[one for one in figures if one.name.startswith("figure")],
        more=[one for one in figures if not one.name.startswith("figure")],
        departures=departures,
        videos=videos,
        verdict=verdict_table(results),
        shown=" and ".join(shown),
    )
    titles = re.findall(r"^## (.+)$", page, re.MULTILINE)
    links = " · ".join(f"[{title}](#{_anchor(title)})" for title in titles)
    return page.replace("[contents]", links, 1)


def _anchor(title: str) -> str:
    """The anchor that GitHub gives a heading."""
    return re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-")


def render_html(markdown: str, folder: Path, *, title: str, banner: str) -> str:
    """A self-contained HTML page, in which pictures and videos of `folder` are embedded."""

    def embedded(name: str, kind: str) -> str:
        encoded = base64.b64encode((folder / name).read_bytes()).decode("ascii")
        return f'src="data:{kind};base64,{encoded}"'

    def video(match: re.Match[str]) -> str:
        return (
            f"<video controls loop muted {embedded(match[1], 'video/mp4')}></video>\n<p>{match[2]}"
        )

    body = MarkdownIt("commonmark", {"html": False}).enable("table").render(markdown)
    body = re.sub(
        r'src="(figures/[\w.-]+\.(png|webp))"', lambda m: embedded(m[1], f"image/{m[2]}"), body
    )
    body = re.sub(r'<p><a href="(videos/[\w.-]+\.mp4)">(.*?)</a>', video, body)
    # A sequence's name could contain a link to a remote picture: drop it, browsers would load it.
    body = re.sub(r'<img (?!src="data:)[^>]*>', "", body)
    body = re.sub(r"<h2>(.*?)</h2>", lambda h: f'<h2 id="{_anchor(h[1])}">{h[1]}</h2>', body)
    # The only HTML that is allowed in the Markdown: foldable sections.
    body = re.sub(
        r"<p>&lt;details&gt;&lt;summary&gt;(.*?)&lt;/summary&gt;</p>",
        r"<details><summary>\1</summary>",
        body,
    ).replace("<p>&lt;/details&gt;</p>", "</details>")
    for mark, name in ((_NEARER, "nearer"), (_FARTHER, "farther")):
        body = body.replace(f">{mark} ", f'><b class="{name}">{mark}</b> ')
    # On a narrow screen a wide table scrolls, not the page.
    body = body.replace("<table>", '<div class="wide"><table>')
    body = body.replace("</table>", "</table></div>")
    return fill_template("page.html.j2", title=title, banner=banner, body=body)
