"""The documentation site is the tree itself: README, the pages of `docs/`, examples, docstrings.

`docs/README.md` is the one place that orders the pages: its `##` headings are the menu's sections,
the links in the lists below them the entries. The strict build refuses a page that it lacks.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path, PurePosixPath
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from pygments.formatters import HtmlFormatter

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("bridge", "dsnet", "torch_align_ae", "tf_dsnet", "benchmarks")
# Files and folders that pages of another name stand for.
STAND_INS = {
    ".": "index.md",
    "README.md": "index.md",
    "docs": "contents.md",
    "docs/README.md": "contents.md",
    "docs/results": "contents.md",
    "examples": "examples.md",
}
_LINK = re.compile(r'(?:(?<=\[)`(?P<name>[\w.]+)`)?(?:\]\(|src="|href=")(?P<to>[^)#"\s]+)')
_ENTRY = re.compile(r"^(?:## (?P<section>.+)|- \[(?P<title>[^\]]+)\]\((?P<to>[^)\s]+)\).*)$", re.M)

Menu = list[dict[str, Any]]


def on_config(config: MkDocsConfig) -> None:
    """The menu: sections and pages as `docs/README.md` orders them, then every module."""
    config.nav = [
        *menu((ROOT / "docs" / "README.md").read_text(encoding="utf-8")),
        {"API": modules_menu()},
    ]


def on_files(files: Files, config: MkDocsConfig) -> None:
    """Add the pages that are made from other files of the tree."""
    contents = files.src_uris["README.md"]
    files.remove(contents)
    made = {
        "index.md": (ROOT / "README.md").read_text(encoding="utf-8"),
        "contents.md": contents.content_string,
        "examples.md": examples_page(sorted((ROOT / "examples").glob("*.py"))),
        "site.css": (ROOT / "tools" / "site" / "site.css").read_text(encoding="utf-8"),
        "pygments.css": HtmlFormatter().get_style_defs(".highlight"),
        **{module_page(path): f"::: {module_name(path)}\n" for path in modules()},
    }
    for uri, content in made.items():
        files.append(File.generated(config, uri, content=content))


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Links as a forge reads them become links of the site."""
    source = {"index.md": "README.md", "contents.md": "docs/README.md"}
    uri = page.file.src_uri
    if uri == "viewer.md":  # what only the site has
        markdown += '\n<p><a href="demo.html">The packaged model, alive in this browser</a></p>\n'
    return with_site_links(markdown, source.get(uri, f"docs/{uri}"), uri)


def menu(contents: str) -> Menu:
    """The sections and titled pages of a table of contents that lies in `docs/`."""
    sections: Menu = []
    entries: Menu = []
    for found in _ENTRY.finditer(contents):
        if found["section"]:
            sections.append({found["section"]: (entries := [])})
        else:
            page = site_page(posixpath.normpath(f"docs/{found['to']}"))
            entries.append({found["title"].replace("`", ""): page or found["to"]})
    return sections


def with_site_links(markdown: str, source: str, uri: str) -> str:
    """A page's text, its links turned from those beside `source` to those at `uri` of the site."""

    def turned(link: re.Match[str]) -> str:
        path = posixpath.normpath(posixpath.join(posixpath.dirname(source), link["to"]))
        target = site_page(path)
        if target is None or "://" in link["to"]:
            return link[0]
        relative = posixpath.relpath(target, posixpath.dirname(uri) or ".")
        if link["name"] and target.startswith("api/") and not link["name"].endswith(".py"):
            relative += f"#{module_name(path)}.{link['name']}"
        return link[0].removesuffix(link["to"]) + relative

    return _LINK.sub(turned, markdown)


def site_page(path: str) -> str | None:
    """Where the site shows a file or folder of the tree; None where it does not."""
    top, _, inner = path.partition("/")
    if path in STAND_INS or top == "examples":
        return STAND_INS.get(path, STAND_INS["examples"])
    if top in PACKAGES and path.endswith(".py"):
        return module_page(path)
    return inner if top == "docs" else None


def modules() -> list[str]:
    """Paths of the packages' public modules, each folder's `__init__.py` before its files."""
    by_package = (sorted((ROOT / name).rglob("*.py"), key=_in_menu) for name in PACKAGES)
    paths = [path.relative_to(ROOT).as_posix() for found in by_package for path in found]
    return [path for path in paths if not re.search(r"/_(?!_init__)", path)]


def _in_menu(path: Path) -> tuple[Path, bool, Path]:
    return path.parent, path.name != "__init__.py", path


def module_name(path: str) -> str:
    """`dsnet.evaluation` for `dsnet/evaluation/__init__.py`."""
    return path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


def module_page(path: str) -> str:
    """The page of a module's docstrings."""
    return f"api/{module_name(path)}.md"


def modules_menu() -> Menu:
    """A section for each package, with its modules."""
    packages: dict[str, Menu] = {}
    for path in modules():
        package = module_name(f"{PurePosixPath(path).parent}/__init__.py")
        title = module_name(path).removeprefix(f"{package}.")
        packages.setdefault(package, []).append({title: module_page(path)})
    return [{package: pages} for package, pages in packages.items()]


def examples_page(scripts: list[Path]) -> str:
    """Every example with its source, in reading order."""
    shown = [
        f"## {path.name}\n\n```python\n{path.read_text(encoding='utf-8')}```" for path in scripts
    ]
    return "\n\n".join(["# Examples", "Scripts of `examples/`, in reading order.", *shown])
