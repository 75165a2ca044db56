"""`dsnet view`: predictions in a browser, as they move."""

from __future__ import annotations

import threading
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Literal

from bridge.errors import notify
from bridge.motion.motion import Up
from bridge.options import Bounds, PositiveFloat, check_options
from bridge.runs import Run


@dataclass(frozen=True)
class ViewConfig:
    """Show SMPL alone, predictions and the truth in a browser, alive: the model runs in the page.

    Its knobs are gains, shape, loop, floor and speed; `dsnet export --to html` writes the same page
    as a file."""

    run: str | None = None
    """Run whose predictors and motions are shown; the small model that comes with the package
    when left out, of the motion's gender."""
    body: Path | None = None
    """Another body than the predictor was trained on, or DSNET_BODY for always: an SMPL, SMPL-H or
    SMPL-X model file, or a folder of them."""
    gender: Literal["female", "male", "neutral"] | None = None
    """Of the body, where the motion file says none or another."""
    motion: Path | None = None
    """AMASS `.npz`, a BVH, or a sample such as `sample:walking`, that is shown first."""
    motion_fps: PositiveFloat | None = None
    """Frames per second of the motion file, where what it says of itself is wrong."""
    smooth_hz: PositiveFloat | Literal["auto"] | None = None
    """Leave out what is faster in the motion file."""
    up: Up = "auto"
    """Vertical axis of the motion file; `auto`: the one along which its bodies stand."""
    joint_map: Path | None = None
    """Text file that says which joint of a BVH is which, `left_hip = Bip01 L Thigh` a line."""
    pose: Literal["file", "bony"] = "file"
    """`bony`: the chest follows the motion file's markers on bone."""
    port: Annotated[int, Bounds(0, 65535)] = 8080
    """Port to serve on, for this machine alone; 0 takes any that is free."""


PROFILES = dict.fromkeys(("smoke", "demo", "paper"), ViewConfig())


def main(config: ViewConfig) -> None:
    """Serve the page until it is interrupted."""
    check_options(config)
    # Late: what moves bodies takes a second to load.
    from dsnet.prediction.controls import Controls
    from dsnet.view.clip_list import open_repertoire
    from dsnet.view.page import serving
    from dsnet.view.scene import Scene

    run = None if config.run is None else Run(config.run)
    names = {field.name for field in fields(Controls)} & set(vars(config))
    asked = Controls(**{name: getattr(config, name) for name in names})
    repertoire = open_repertoire(run, config.motion, asked)
    with serving(Scene(repertoire), config.port) as address:
        notify(f"{repertoire.best.owner}: open {address} in a browser; Ctrl-C ends it")
        threading.Event().wait()
