"""Whose shape a motion's betas are: meant on a body of their space, never silently on another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.model_data import GENDERS
from bridge.body.posing import fitted_betas
from bridge.errors import DsnetError, notify
from bridge.markers.marker_files import marker_file, read_markers
from bridge.markers.person import fit_person
from bridge.motion import Motion

_REMEDY = "--shape says another, --body takes the body model whose betas they are"
_SPACES = {"smpl": "SMPL's", "smplh": "SMPL's", "smplx": "SMPL-X's"}


def with_own_shape(motion: Motion, body: BodyModelData, told: bool = True) -> Motion:
    """A motion as its file has it, with betas (S,) that mean its person on the body.

    On a body of their space and gender they are the file's: of SMPL's family, or, if this project
    wrote the file, an embedded one. Any other takes the shape that the file's markers say, or its
    mean one, and a line on stderr says which, if it is to be `told`.
    """
    given = np.concatenate([motion.betas, motion.more_betas])
    betas, note = fitted_betas(body, given)
    if motion.embedded_betas:
        note = None
    if given.any() and (whose := _strange_space(motion, body)):
        betas, how = _of_markers(motion, body)
        note = f"the betas of {motion.source} are {whose}: {how}; {_REMEDY}"
    if note and told:
        notify(note)
    padded = np.pad(betas, (0, body.shapedirs.shape[-1] - len(betas)))
    return replace(motion, betas=padded, more_betas=np.zeros(0))


def _strange_space(motion: Motion, body: BodyModelData) -> str:
    """Whose betas a motion's are, empty if the body's: women and men have other shapes."""
    if body.source == "synthetic" and not motion.embedded_betas:
        return "another body model's"
    theirs, ours = _SPACES.get(motion.kind or body.kind), _SPACES[body.kind]
    if body.source != "synthetic" and theirs != ours:
        return f"{theirs}, the body {ours}"
    if motion.gender != body.gender and {motion.gender, body.gender} <= {*GENDERS}:
        return f"a {motion.gender} body's, the body is {body.gender}"
    return ""


def _of_markers(motion: Motion, body: BodyModelData) -> tuple[NDArray[np.float64], str]:
    """Betas of the person whose markers a file has, or of the mean shape, and how they are."""
    mean = np.zeros(body.shapedirs.shape[-1])
    path = marker_file(motion.source)
    if path is None:
        return mean, "the mean shape is taken"
    try:
        fitted = fit_person(body, motion, read_markers(path, motion.source_fps, motion.duration_s))
    except DsnetError as error:
        return mean, f"the mean shape is taken, as its markers are no help ({error.received})"
    return fitted.betas, (
        f"the shape is fitted to its markers, which lie {fitted.fitted_mm:.0f} mm off the skin, of "
        f"the mean shape {fitted.mean_shape_mm:.0f}"
    )
