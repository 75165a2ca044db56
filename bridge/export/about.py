"""What is written into every exported file: whose body it is, what moves it, in which units."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from bridge.runtime.moving_body import MovingBody


def about(moving: MovingBody) -> dict[str, Any]:
    """Facts of an export, as JSON has them; `data` says `synthetic` or `licensed`.

    Predictor, label, betas, fps and controls have the names and values that the manifest of
    `dsnet predict` gives them.
    """
    chosen, motion = moving.trained, moving.motion
    return {
        "data": chosen.origin,
        "made_by": "dsnet",
        "predictor": chosen.name,
        "label": chosen.label,
        "model": chosen.owner,
        "body_model": Path(chosen.body_model).name,
        "gender": moving.body.gender,
        "betas": [float(beta) for beta in motion.betas],
        "motion": motion.source.name,
        "frames": len(moving),
        "fps": motion.fps,
        "length_unit": "m",
        "up_axis": motion.up,
        "controls": json.loads(json.dumps(moving.controls)),
    }


def controls_in_a_line(moving: MovingBody) -> str:
    """What was asked of the body, as the JSON that the manifest of `dsnet predict` has."""
    return json.dumps(moving.controls)


def about_in_a_line(moving: MovingBody, *beside: MovingBody) -> str:
    """The same for a comment: one line of printable ASCII.

    Parameters
    ----------
    beside : what other predictors make of the same, if they are in the same file.
    """
    facts = about(moving)
    predictors = ", ".join(one.trained.name for one in (moving, *beside))
    text = (
        f"{facts['data']} data; dsnet: {predictors} of {facts['model']}, body model "
        f"{facts['body_model']}, motion {facts['motion']}, controls {controls_in_a_line(moving)}; "
        f"metres, {facts['up_axis']} up, {facts['fps']:g} frames a second"
    )
    return "".join(sign if sign.isprintable() and sign.isascii() else "?" for sign in text)
