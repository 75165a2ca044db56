"""A moving body as one page that plays in any browser, without a network."""

from __future__ import annotations

from pathlib import Path

from bridge.export.output import about_in_a_line
from bridge.motion.readers.amass import SAMPLE_PREFIX
from bridge.runtime.controls import gains_of_parts
from bridge.runtime.moving_body import MovingBody
from bridge.view.page import document
from bridge.view.repertoire import Repertoire, take_of
from bridge.view.scene import Scene, Start


def write(path: Path, moving: MovingBody, *beside: MovingBody) -> None:
    """Write one file; `beside` is what other predictors make of the same motion."""
    trained = {one.trained.name: one.trained for one in (moving, *beside)}
    first, motion = moving.trained, moving.motion
    take, read_truth = take_of(moving)
    controls = moving.controls
    repertoire = Repertoire(
        first.owner,
        first.origin,
        first.body,
        first.body_model,
        predictors={name: one.label for name, one in trained.items()},
        open=trained.__getitem__,
        takes={motion.source.stem.removeprefix(SAMPLE_PREFIX): take},
        read_truth=read_truth,
    )
    start = Start(
        gain=float(controls.get("gain", 1.0)),
        parts=tuple(map(float, gains_of_parts(controls.get("part_gain", ())))),
        loop=bool(controls.get("loop", False)),
    )
    scene = Scene(repertoire, start, moving.loop)
    path.write_text(
        document(scene, about_in_a_line(moving, *beside)), encoding="utf-8", newline="\n"
    )
