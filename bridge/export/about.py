"""What is written into every exported file: whose body it is, its units, rate and up axis."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bridge.runtime.moving_body import MovingBody


def about(moving: MovingBody) -> dict[str, Any]:
    """Facts of an export, as plain numbers and texts; `data` says `synthetic` or `licensed`."""
    chosen, motion = moving.character.chosen, moving.motion
    return {
        "data": chosen.trained.origin,
        "made_by": "dsnet",
        "predictor": chosen.name,
        "model": chosen.owner,
        "body_model": Path(chosen.body_model).name,
        "gender": moving.character.body.gender,
        "betas": [float(beta) for beta in motion.betas],
        "motion": motion.source.name,
        "frames": len(moving),
        "fps": motion.fps,
        "length_unit": "m",
        "up_axis": motion.up,
    }


def about_in_a_line(moving: MovingBody) -> str:
    """The same for a comment: one line of printable ASCII."""
    facts = about(moving)
    text = (
        f"{facts['data']} data; dsnet: {facts['predictor']} of {facts['model']}, body model "
        f"{facts['body_model']}, motion {facts['motion']}; metres, {facts['up_axis']} up, "
        f"{facts['fps']:g} frames a second"
    )
    return "".join(sign if sign.isprintable() and sign.isascii() else "?" for sign in text)
