"""Common to all exports: a path that appears only when it is complete, and facts for the file."""

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
    """A temporary path that is renamed to `out` at the end; after an exception nothing is left.

    It has the same name, as some writers go by its suffix. `DsnetError` if `out` exists, lies in a
    run, cannot be written, or is being written by another process.
    """
    refuse_existing(out)
    out = out.resolve()
    what, remedy = f"--out {out}", "Wait until it has ended, or name another path."
    try:
        with exclusive(out, what, remedy) as work:
            refuse_existing(out)  # again, as it may have appeared before the lock was ours
            (made := work / "made").mkdir()  # apart from the lock, which has a name too
            yield made / out.name
            os.replace(made / out.name, out)
    except UnicodeEncodeError as error:
        raise DsnetError(
            f"--out {out}, whose bytes are no UTF-8, which this format's library takes alone",
            "a path in UTF-8",
            "Name another path.",
        ) from error
    except OSError as error:
        raise DsnetError(
            f"--out {out}, which cannot be written ({error.strerror or error})",
            "a path that can be made, on a disk with room",
            "Name another path.",
        ) from error


def refuse_existing(out: Path) -> None:
    """Refuse a path that exists, or lies in a run."""
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


def export_facts(moving: MovingBody) -> dict[str, Any]:
    """Facts of an export as JSON values; `data` is `synthetic`, `synthetic flesh` or `licensed`.

    Predictor, label, betas, fps and controls have the names and values of the manifest that
    `dsnet predict` writes.
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


def facts_in_a_line(moving: MovingBody, *others: MovingBody) -> str:
    """The same as one line of printable ASCII, for a comment.

    `others` are the same motion by other predictors, if they are in the same file.
    """
    facts = export_facts(moving)
    predictors = ", ".join(one.trained.name for one in (moving, *others))
    text = (
        f"{facts['data']} data; dsnet: {predictors} of {facts['model']}, body model "
        f"{facts['body_model']}, motion {facts['motion']}, controls {json.dumps(moving.controls)}; "
        f"metres, {facts['up_axis']} up, {facts['fps']:g} frames a second"
    )
    return "".join(c if c.isprintable() and c.isascii() else "?" for c in text)
