"""Whose shape a motion's betas are: meant on a body of their space, never silently on another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.errors import DsnetError, notify
from bridge.markers.marker_files import marker_file, read_markers
from bridge.markers.person import fit_person
from bridge.motion import Motion

_REMEDY = "--shape says another, --body takes the body model whose betas they are"


def with_own_shape(motion: Motion, body: BodyModelData, told: bool = True) -> Motion:
    """A motion as its file has it, with betas (S,) that mean its person on the body.

    On a body of SMPL's family they are the file's, and so on an embedded one if this project wrote
    the file. Else an embedded body takes the shape that the file's markers say, or the mean one,
    and a line on stderr says which, if it is to be `told`.
    """
    count = body.shapedirs.shape[-1]
    if body.source == "licensed" or motion.embedded_betas or not motion.betas.any():
        return replace(motion, betas=_of_length(motion, count))
    whose = f"the betas of {motion.source} are another body model's"
    betas = np.zeros(count)
    if path := marker_file(motion.source):
        try:
            markers = read_markers(path, motion.source_fps, motion.duration_s)
            fitted = fit_person(body, motion, markers)
            betas = fitted.betas
            how = (
                f"the shape is fitted to its markers, which lie {fitted.fitted_mm:.0f} mm off the "
                f"skin instead of {fitted.mean_shape_mm:.0f}"
            )
        except DsnetError as error:
            how = f"the mean shape is taken, as its markers cannot be used ({error.received})"
    else:
        how = "the mean shape is taken"
    if told:
        notify(f"{whose}: {how}; {_REMEDY}")
    return replace(motion, betas=betas)


def _of_length(motion: Motion, count: int) -> NDArray[np.float64]:
    """(count,) the file's betas, with zeros behind, or without those that the body has not."""
    given = motion.betas
    if given[count:].any():
        notify(
            f"{motion.source} has {len(given)} betas, the body {count}: the last "
            f"{len(given) - count} are left out"
        )
    return np.pad(given[:count], (0, max(0, count - len(given))))
