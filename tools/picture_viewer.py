"""Take the picture of the viewer in docs/viewer.md, in a headless Chromium.

    python tools/picture_viewer.py --run RUN

Without --run it shows the packaged model, whose samples have no truth beside them.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.processes import run_as_process
from tools.headless_chromium import PATIENCE_MS, chromium, open_page
from tools.served_viewer import served_viewer

if TYPE_CHECKING:
    from playwright.sync_api import Page

PICTURE = Path(__file__).parents[1] / "docs" / "images" / "viewer.jpg"
_SIZE_PX = 1400, 900
_APART_S, _ALIKE = 5.0, 3
"""So many pictures in a row are the same when what fades in and moves by itself is at rest."""


@dataclass(frozen=True)
class Picture:
    """What is to be seen."""

    run: str | None = None
    """Run whose first motion is shown; the packaged model when left out."""
    motion: Path | None = None
    """Motion to show instead."""
    frame: int = 44
    """Which of its frames."""
    out: Path = PICTURE
    """Where to write it."""


def main(config: Picture) -> None:
    """Show the viewer at one frame, and write what the browser shows.

    Raises
    ------
    DsnetError
        If the browser, or what is to be seen, is missing.
    """
    with served_viewer(config.run, config.motion) as served:
        served.viewer.timeline.playing = False
        served.viewer.timeline.go_to(config.frame)
        with served.drawing():
            _take(served.address, config.out)


def _take(address: str, path: Path) -> None:
    with chromium() as browser, open_page(browser, address, *_SIZE_PX) as opened:
        opened.page.get_by_role("button", name="Play").wait_for()
        opened.page.get_by_text("computing").wait_for(state="hidden")
        # The browser's remark that no graphics card is there is no part of the viewer.
        close = opened.page.locator(".mantine-Notification-closeButton")
        close.first.dispatch_event("click")
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(_at_rest(opened.page))


def _at_rest(page: Page) -> bytes:
    """A JPEG of the page when nothing in it moves any more."""
    pictures: list[bytes] = []
    while len(pictures) < _ALIKE or len(set(pictures[-_ALIKE:])) > 1:
        time.sleep(_APART_S)
        pictures.append(page.screenshot(type="jpeg", quality=85, timeout=PATIENCE_MS))
    return pictures[-1]


if __name__ == "__main__":
    run_as_process(Picture, main)
