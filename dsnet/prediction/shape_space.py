"""Shape space of a motion and of a body: betas and places mean something else on another kind."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.model_data import GENDERS
from bridge.body.posing import fitted_betas
from bridge.errors import DsnetError, notify
from bridge.motion import Motion
from dsnet.markers.marker_files import markers_of
from dsnet.markers.person import fit_person

UseOfBetas: TypeAlias = Literal["used", "not used", "none"]
"""What becomes of a file's betas."""
_REMEDY = "--shape says another, --body takes the body model whose betas they are"
_EMBEDDED = "an embedded body's"
_SPACES = {"smpl": "SMPL's", "smplh": "SMPL's", "smplx": "SMPL-X's"}
PELVIS_M = {
    _EMBEDDED: (0.0, 0.0, 0.0),
    "SMPL's": (-0.002, -0.241, 0.029),
    "SMPL-X's": (0.003, -0.351, 0.012),
}
"""Where mean templates have it: a root's translation counts from there. Of the published models of
SMPL and SMPL-X, rounded to millimetres; one place serves women and men."""


def with_betas_on(motion: Motion, body: BodyModelData, warn: bool = True) -> Motion:
    """A motion as its file has it, with betas (S,) that mean its person on the body.

    On a body of their space and gender they are the file's: of SMPL's family, or, if this project
    wrote the file, an embedded one. Any other, and zeros beside markers, are replaced by a shape
    that is fitted to the markers, or by the mean one. If it is to `warn`, a line on stderr says
    which, or that the file does not say whose betas it has and they are taken as the body's.
    """
    given = np.concatenate([motion.betas, motion.more_betas])
    unstated = motion.kind is None or motion.gender == "unknown"
    betas, note = fitted_betas(body, given)
    notes = [] if note is None or motion.embedded_betas else [note]
    if whose := _other_space(motion, body):
        betas, how = _of_markers(motion, body)
        notes = [f"the betas of {motion.source} are {whose}: {how}; {_REMEDY}"]
    elif given.any() and (unstated or body.gender not in GENDERS) and not motion.embedded_betas:
        taken = f"{motion.source} does not say whose betas it has: taken as the body's"
        if not unstated:
            taken = f"{body.name} does not say its gender: it takes a {motion.gender} body's betas"
        notes.append(f"{taken}; {_REMEDY}")
    for line in notes if warn else ():
        notify(line)
    padded = np.pad(betas, (0, body.shapedirs.shape[-1] - len(betas)))
    return replace(motion, betas=padded, more_betas=np.zeros(0))


def use_of_betas(motion: Motion, body: BodyModelData) -> UseOfBetas:
    """Whether the body takes a file's betas, or whether the file has `none` but zeros."""
    if not motion.betas.any() and not motion.more_betas.any():
        return "none"
    return "not used" if _other_space(motion, body) else "used"


def pelvis_apart_m(motion: Motion, body: BodyModelData) -> NDArray[np.float64]:
    """(3,) from the pelvis of the body's template to where that of the file's kind of body lies. A
    file that does not say its kind is of the body's, or SMPL's where that is an embedded one."""
    theirs, ours = _spaces(motion, body)
    theirs = theirs or ("SMPL's" if ours == _EMBEDDED else ours)
    return np.zeros(3) if theirs == ours else PELVIS_M[theirs] - body.joints[0]


def _spaces(motion: Motion, body: BodyModelData) -> tuple[str | None, str]:
    """Whose betas a motion has, None where its file does not say, and whose the body takes."""
    theirs = _EMBEDDED if motion.embedded_betas else _SPACES.get(motion.kind or "")
    return theirs, _EMBEDDED if body.source == "synthetic" else _SPACES[body.kind]


def _other_space(motion: Motion, body: BodyModelData) -> str:
    """Whose betas a motion's are, empty if the body's: women and men have other shapes."""
    theirs, ours = _spaces(motion, body)
    if not motion.betas.any() and not motion.more_betas.any():
        return "all zero" if theirs != _EMBEDDED and motion.markers else ""
    if theirs != ours and _EMBEDDED in (theirs, ours):
        return "another body model's"
    if theirs not in (None, ours):
        return f"{theirs}, the body {ours}"
    if motion.gender != body.gender and {motion.gender, body.gender} <= {*GENDERS}:
        return f"a {motion.gender} body's, the body is {body.gender}"
    return ""


def _of_markers(motion: Motion, body: BodyModelData) -> tuple[NDArray[np.float64], str]:
    """Betas of the person whose markers a file has, or of the mean shape, and how they are."""
    mean = np.zeros(body.shapedirs.shape[-1])
    if motion.markers is None:
        return mean, "the mean shape is taken"
    try:
        fitted = fit_person(body, motion, markers_of(motion))
    except DsnetError as error:
        return mean, f"the mean shape is taken, as its markers are no help ({error.received})"
    return fitted.betas, (
        f"the shape is fitted to its markers, which lie {fitted.fitted_mm:.0f} mm off the skin, of "
        f"the mean shape {fitted.mean_shape_mm:.0f}"
    )
