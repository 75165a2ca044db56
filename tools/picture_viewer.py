"""Take the picture of the viewer in docs/viewer.md, in a headless Chromium.

python tools/picture_viewer.py [--run RUN]
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from benchmarks.processes import run_as_process
from bridge.errors import DsnetError
from bridge.runs import Run
from dsnet.prediction.controls import Controls
from dsnet.view.application import opened
from dsnet.view.clip_list import open_clip_list
from dsnet.view.scene import Scene
from dsnet.view.server import serving
from tools.headless_chromium import PATIENCE_MS, chromium, open_page, why_missing

PICTURE = Path(__file__).parents[1] / "docs" / "images" / "viewer.jpg"
_SHOW = """([frame, colouring]) => { page.play(false); page.seek(frame);
  document.getElementById("colouring").value = colouring; }"""
_SHOWN = (
    """(frame) => page.time === frame && page.curves.filter(Boolean).length === page.motion.count"""
)


@dataclass(frozen=True)
class Picture:
    """What is to be seen."""

    run: str | None = None
    """Run whose first motion is shown; the packaged model when left out."""
    frame: int = 66
    """Which of its frames."""
    out: Path = PICTURE
    """Where to write it."""


def main(config: Picture) -> None:
    """Show the viewer at one frame, and write what the browser shows."""
    if why := why_missing():
        raise DsnetError(why, "a browser", "Install it.")
    run = None if config.run is None else Run(config.run)
    motion = None if run else Path("sample:jumping_jacks")
    scene = Scene(open_clip_list(run, motion))
    with (
        opened(scene, run, Controls()) as application,
        serving(application, 0) as address,
        chromium() as browser,
        open_page(browser, address, 1280, 760) as shown,
    ):
        page = shown.page
        page.wait_for_selector("body[data-ready]", state="attached")
        page.evaluate(_SHOW, [config.frame, "size"])
        while not page.evaluate(_SHOWN, config.frame):
            time.sleep(0.2)
        time.sleep(2)  # until it is drawn
        picture = page.screenshot(type="jpeg", quality=85, timeout=PATIENCE_MS)
    config.out.write_bytes(picture)


if __name__ == "__main__":
    run_as_process(Picture, main)
