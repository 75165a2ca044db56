"""What all exports have in common: a path that appears when it is whole, and facts in the file."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from bridge.errors import DsnetError
from bridge.runs.files import exclusive, runs_root
from dsnet.prediction.moving_body import MovingBody


@contextmanager
def new_path(out: Path) -> Iterator[Path]:
    """Where to write what will be `out`; an exception leaves nothing.

    The path has the same name, so that writers which go by suffixes find theirs. `DsnetError` if
    `out` is there, lies in a run, cannot be written, or another process is writing it.
    """
    refuse_taken(out)
    out = out.resolve()
    what, remedy = f"--out {out}", "Wait until it has ended, or name another path."
    try:
        with exclusive(out, what, remedy) as work:
            refuse_taken(out)  # once more: it may have been made before we were alone
            (made := work / "made").mkdir()  # the lock beside it has a name, too
            yield made / out.name
            os.replace(made / out.name, out)
    except OSError as error:
        raise DsnetError(
            f"--out {out}, which cannot be written ({error.strerror or error})",
            "a path that can be made, on a disk with room",
            "Name another path.",
        ) from error


def refuse_taken(out: Path) -> None:
    """Refuse a path that is there, or lies in a run."""
    if os.path.lexists(out):
        raise DsnetError(
            f"--out {out}, which exists", "a new path", "Remove it, or name another path."
        )
    if runs_root().resolve() in out.resolve().parent.parents:
        raise DsnetError(
            f"--out {out}, a path in a run",
            "a path outside of the runs",
            "Name another path.",
        )


def about(moving: MovingBody) -> dict[str, Any]:
    """Facts of an export, as JSON has them; `data` says `synthetic`, `synthetic flesh` or
    `licensed`.

    Predictor, label, betas, fps and controls have the names and values that the manifest of
    `dsnet predict` gives them.
    """
    chosen, motion = moving.trained, moving.motion
    return {
        "data": chosen.shows,
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


def about_in_a_line(moving: MovingBody, *beside: MovingBody) -> str:
    """The same for a comment: one line of printable ASCII.

    `beside` is what other predictors make of the same motion, if they are in the same file.
    """
    facts = about(moving)
    predictors = ", ".join(one.trained.name for one in (moving, *beside))
    text = (
        f"{facts['data']} data; dsnet: {predictors} of {facts['model']}, body model "
        f"{facts['body_model']}, motion {facts['motion']}, controls {json.dumps(moving.controls)}; "
        f"metres, {facts['up_axis']} up, {facts['fps']:g} frames a second"
    )
    return "".join(sign if sign.isprintable() and sign.isascii() else "?" for sign in text)
