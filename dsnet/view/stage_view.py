"""`dsnet view`: a page in which the model runs and moving bodies are compared."""

from __future__ import annotations

import os
import sys
import threading
import webbrowser
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

from bridge.errors import notify
from bridge.options import Bounds, check_options
from bridge.runs import Run
from dsnet.prediction.motion_options import MotionOptions

_SCREENS = {"DISPLAY", "WAYLAND_DISPLAY"}


@dataclass(frozen=True, kw_only=True)
class ViewConfig(MotionOptions):
    """Show SMPL alone, predictions and the truth in a browser; the model runs in the page.

    Motion files are dropped onto the page, and what it shows is exported from there. `dsnet export
    --to html` writes the same page as a file, in which the model runs too."""

    run: str | None = None
    """Run whose predictors and motions are shown; by default the small packaged model of the
    motion's gender."""
    motion: Path | None = None
    """Motion to show first: AMASS `.npz`, BVH and others (docs/motion_files.md), or
    `sample:walking`."""
    port: Annotated[int, Bounds(0, 65535)] = 8080
    """Port to serve on, to this machine alone; 0 takes any free port."""
    browser: bool = True
    """Open a browser at the printed address, where there is a screen."""


PROFILES = dict.fromkeys(("smoke", "demo", "paper"), ViewConfig())


def main(config: ViewConfig) -> None:
    """Serve the page until it is interrupted."""
    check_options(config)
    # Imported here: they take a second to load, and bad options are refused before.
    from dsnet.prediction.controls import Controls
    from dsnet.view.application import opened
    from dsnet.view.clip_list import open_clip_list
    from dsnet.view.scene import Scene
    from dsnet.view.server import serving

    run = None if config.run is None else Run(config.run)
    controls = Controls(**{one.name: getattr(config, one.name) for one in fields(MotionOptions)})
    clip_list = open_clip_list(run, config.motion, controls)
    with (
        opened(Scene(clip_list), run, controls) as application,
        serving(application, config.port) as address,
    ):
        notify(f"{clip_list.best.owner}: open {address} in a browser; Ctrl-C ends it")
        # Without a screen Python would open a browser in this terminal.
        if config.browser and (sys.platform != "linux" or _SCREENS & {*os.environ}):
            webbrowser.open(address)
        threading.Event().wait()
