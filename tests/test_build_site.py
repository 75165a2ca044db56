"""The documentation site: links of the tree become links of the site, and each leads somewhere."""

from __future__ import annotations

import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag

import pytest

from tests.sources import ROOT
from tools.site import hook

BUILD = (sys.executable, "tools/build_site.py")
# What a browser fetches by itself; `a` only leads away.
FETCHED = {"audio", "embed", "iframe", "img", "link", "script", "source", "track", "video"}


class Html(HTMLParser):
    """The anchors of a page, where its links lead, and what it fetches."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: set[str] = set()
        self.fetched: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {name: value for name, value in attrs if value is not None}
        self.anchors |= {values[name] for name in ("id", "name") if name in values}
        found = {values[name] for name in ("href", "src", "poster", "data") if name in values}
        self.links |= found
        self.fetched |= found if tag in FETCHED else set()


@pytest.mark.parametrize(
    ("source", "uri", "written", "expected"),
    [
        ("README.md", "index.md", "[p](docs/paper.md)", "[p](paper.md)"),
        ("README.md", "index.md", '<img src="docs/a/b.png" w="1">', '<img src="a/b.png" w="1">'),
        *(
            ("docs/paper.md", "paper.md", f"[a]({link})", f"[a]({link})")
            for link in ("https://a.b/docs/paper.md", "figures/a.png", "#here", "a.md")
        ),
        ("docs/paper.md", "paper.md", "[s](../README.md#use-it)", "[s](index.md#use-it)"),
        ("docs/paper.md", "paper.md", "[s](README.md)", "[s](contents.md)"),
        ("docs/paper.md", "paper.md", "[r](../bridge/paper.py)", "[r](api/bridge.paper.md)"),
        ("docs/paper.md", "paper.md", "[e](../examples/03_predict.py)", "[e](examples.md)"),
        (
            "docs/results/demo/report.md",
            "results/demo/report.md",
            "[`SMPL.forward`](../../../torch_align_ae/body/smpl.py)",
            "[`SMPL.forward`](../../api/torch_align_ae.body.smpl.md#torch_align_ae.body.smpl.SMPL.forward)",
        ),
        ("docs/a.md", "a.md", "[body](../bridge/body/__init__.py)", "[body](api/bridge.body.md)"),
    ],
)
def test_a_link_of_the_tree_becomes_one_of_the_site(
    source: str, uri: str, written: str, expected: str
) -> None:
    assert hook.with_site_links(f"a {written} b", source, uri) == f"a {expected} b"


def test_the_menu_is_the_table_of_contents() -> None:
    contents = "# A\n## Use\n- [the `x`](x.md): y\n  - [no](n.md)\n## Start\n- [s](../README.md)\n"
    assert hook.menu(contents) == [{"Use": [{"the x": "x.md"}]}, {"Start": [{"s": "index.md"}]}]


def test_the_table_of_contents_names_every_page_once() -> None:
    sections = hook.menu((ROOT / "docs" / "README.md").read_text())
    named = [page for section in sections for pages in section.values() for page in pages]
    pages = [page for entry in named for page in entry.values()]
    docs = ROOT / "docs"
    written = {path.relative_to(docs).as_posix() for path in docs.rglob("*.md")} - {"README.md"}
    assert sorted(pages) == sorted(written | set(hook.STAND_INS.values()))


def test_a_folder_that_is_no_site_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "kept").touch()
    command = [*BUILD, "--out", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "is no site" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]


@pytest.mark.slow
def test_the_strict_build_passes_and_nothing_in_it_leads_nowhere(tmp_path: Path) -> None:
    site = tmp_path / "site"
    command = [*BUILD, "--out", str(site)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    pages = {path: Html(path) for path in site.rglob("*.html")}
    assert len(pages) > len(hook.modules())
    dead = {
        f"{path.relative_to(site)}: {link}"
        for path, page in pages.items()
        for link in page.links
        if not leads_somewhere(link, path, site, pages)
    }
    assert sorted(dead) == []
    outside = {link for page in pages.values() for link in page.fetched if "//" in link}
    styles = [style.read_text() for style in site.rglob("*.css")]
    outside |= {
        found for style in styles for found in re.findall(r"(?:url\(|@import)[^;)]*//", style)
    }
    assert sorted(outside) == []


def leads_somewhere(link: str, path: Path, site: Path, pages: dict[Path, Html]) -> bool:
    """Whether a link leads out of the site, or to a file and anchor that are there."""
    if re.match(r"(https?|mailto|data):", link):
        return True
    file, anchor = urldefrag(unquote(link))
    # 404.html is shown at any depth, so its links begin at the root.
    target = site / file[1:] if file.startswith("/") else path.parent / file
    target = path if not file else target.resolve()
    target = target / "index.html" if target.is_dir() else target
    if not anchor or target not in pages:
        return target.is_file()
    return anchor in pages[target].anchors
