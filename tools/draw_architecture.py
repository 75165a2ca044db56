"""Draw `docs/images/architecture.svg`: packages and their folders, an arrow for each import.

    python -m tools.draw_architecture

Folders and what they are for come from `docs/architecture.md`, arrows from the source files. An
arrow that follows from others is left out. `tests/test_import_rule.py` holds the picture
against the tree.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from html import escape
from pathlib import Path
from textwrap import wrap

from bridge.runs.files import write_text_atomically

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "images" / "architecture.svg"
_PACKAGE = re.compile(r"^    (\w+)/ +(.+)\n((?: {8}\w+/ .*\n)*)", re.MULTILINE)
_FOLDER = re.compile(r"^ {8}(\w+)/", re.MULTILINE)
_WIDTH, _BOX, _GAP, _HEAD = 960, (104, 28), 26, 50
_COLOURS = {
    "bridge": "#e8eef6",
    "dsnet": "#fbeee0",
    "torch_align_ae": "#f7e3e0",
    "tf_dsnet": "#fdf3d4",
}
Point = tuple[float, float]
Box = tuple[float, float, float, float]
_STYLE = (
    "text{font:13px sans-serif;text-anchor:middle;fill:#222}.name{font-weight:bold}"
    ".about{font-size:11px;fill:#555}rect{stroke:#777}line{stroke:#777;marker-end:url(#to)}"
)
_ARROWHEAD = (
    '<marker id="to" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" markerHeight="7"'
    ' orient="auto"><path d="M0 0L8 4L0 8z" fill="#777"/></marker>'
)


def packages() -> dict[str, tuple[str, list[str]]]:
    """What each package is for and its folders, as the page lists them."""
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    return {name: (about, _FOLDER.findall(inner)) for name, about, inner in _PACKAGE.findall(page)}


def imports(package: str, folders: list[str]) -> dict[str, set[str]]:
    """Which folders of a package the files of each folder import."""
    return {
        folder: {
            name.split(".")[1]
            for path in (ROOT / package / folder).rglob("*.py")
            for name in _imported(path)
            if name.startswith(f"{package}.") and name.split(".")[1] in folders
        }
        - {folder}
        for folder in folders
    }


def _imported(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or ""


def without_detours(graph: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """The arrows that do not follow from others (the transitive reduction)."""
    return {
        source: targets - {far for near in targets for far in _reached(graph, near)}
        for source, targets in graph.items()
    }


def _reached(graph: Mapping[str, set[str]], source: str) -> set[str]:
    return graph[source].union(*(_reached(graph, target) for target in graph[source]))


def rows(graph: Mapping[str, set[str]]) -> list[list[str]]:
    """Folders from the bottom row to the top one, each above what it imports.

    As low or as high as it can be, whichever makes the arrows shorter.
    """
    nearest, low, high = without_detours(graph), dict[str, int](), dict[str, int]()
    for folder in graph:  # each after what it imports
        low[folder] = max((1 + low[target] for target in graph[folder]), default=0)
    for folder in reversed([*graph]):
        importers = [source for source in graph if folder in graph[source]]
        high[folder] = min((high[source] - 1 for source in importers), default=max(low.values()))

    def length(row_of: Mapping[str, int]) -> int:
        return sum(
            row_of[source] - row_of[target] for source in graph for target in nearest[source]
        )

    row_of = min(low, high, key=length)
    ordered: list[list[str]] = []
    place: dict[str, float] = {}
    for row in range(1 + max(row_of.values())):
        level = [folder for folder in graph if row_of[folder] == row]
        # Above what they import, so that few arrows cross.
        level.sort(key=lambda f: sum(place[t] for t in nearest[f]) / max(len(nearest[f]), 1))
        place |= {folder: (n + 0.5) / len(level) for n, folder in enumerate(level)}
        ordered.append(level)
    return ordered


def drawn() -> str:
    """The picture as SVG."""
    described, shapes = packages(), list[str]()
    side, middle, top = 150, 600, 10
    height = _package(shapes, "dsnet", described, (_WIDTH / 2 - middle / 2, top), middle)
    for name, x in (("torch_align_ae", 10), ("tf_dsnet", _WIDTH - 10 - side)):
        _frame(shapes, name, described[name][0], (x, top, side, height))
    y = top + height + 36
    for x in (10 + side / 2, _WIDTH / 2, _WIDTH - 10 - side / 2):
        shapes.append(_arrow((x, top + height), (x, y)))
    bottom = y + _package(shapes, "bridge", described, (10, y), _WIDTH - 20, across=True) + 10
    size = f'width="{_WIDTH}" height="{bottom:g}"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {bottom:g}" {size}>'
    paper = f'<rect {size} fill="white" style="stroke:none"/>'
    style = f"<style>{_STYLE}</style><defs>{_ARROWHEAD}</defs>"
    return "\n".join([head, style, paper, *shapes, "</svg>"]) + "\n"


def _package(
    shapes: list[str],
    name: str,
    described: Mapping[str, tuple[str, list[str]]],
    corner: Point,
    width: float,
    *,
    across: bool = False,
) -> float:
    """Draw a package, its folders and their arrows, which point down, or left; gives its height."""
    about, folders = described[name]
    graph = imports(name, folders)
    levels, (x, y) = rows(graph), corner
    lines = max(map(len, levels)) if across else len(levels)
    height = _HEAD + lines * (_BOX[1] + _GAP)
    _frame(shapes, name, about, (x, y, width, height))
    places: dict[str, Point] = {}  # middle of each box
    for depth, level in enumerate(levels):
        for number, folder in enumerate(level):
            along, beside = (depth + 0.5) / len(levels), (number + 0.5) / len(level)
            right, down = (along, beside) if across else (beside, 1 - along)
            places[folder] = x + right * width, y + _HEAD - 8 + down * (height - _HEAD)
    reach = (_BOX[0] / 2, 0) if across else (0, -_BOX[1] / 2)
    for source, targets in without_detours(graph).items():
        for target in sorted(targets):
            (x1, y1), (x2, y2) = places[source], places[target]
            shapes.append(_arrow((x1 - reach[0], y1 - reach[1]), (x2 + reach[0], y2 + reach[1])))
    for folder, (middle, y1) in places.items():
        box = (middle - _BOX[0] / 2, y1 - _BOX[1] / 2, *_BOX)
        shapes.append(f"<rect {_rectangle(box, 'white')}/>{_text(middle, y1 + 4, folder)}")
    return height


def _frame(shapes: list[str], name: str, about: str, box: Box) -> None:
    x, y, width, _ = box
    middle = x + width / 2
    title = _text(middle, y + 19, name, "name")
    shapes.append(f"<rect {_rectangle(box, _COLOURS[name])}/>{title}")
    for number, line in enumerate(wrap(about.replace("`", ""), int(width / 6.2))):
        shapes.append(_text(middle, y + 35 + 14 * number, line, "about"))


def _rectangle(box: Box, fill: str) -> str:
    x, y, width, height = box
    return f'x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="5" fill="{fill}"'


def _text(x: float, y: float, text: str, kind: str = "") -> str:
    return f'<text x="{x:g}" y="{y:g}" class="{kind}">{escape(text)}</text>'


def _arrow(begin: Point, end: Point) -> str:
    return f'<line x1="{begin[0]:g}" y1="{begin[1]:g}" x2="{end[0]:g}" y2="{end[1]:g}"/>'


if __name__ == "__main__":
    write_text_atomically(PICTURE, drawn())
