"""A motion file as the body that will be posed performs it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.errors import DsnetError
from bridge.motion import Motion, load_motion_file, unpack_theta
from bridge.motion.motion import FARTHEST_M
from bridge.runs.processes import notify
from bridge.runtime.bounds import LARGEST_BODY_M


def place_motion(
    motion: Motion, body: BodyModelData, betas: NDArray[np.float64] | None = None
) -> Motion:
    """A motion, turned to y up about the root joint of the body that will be posed.

    Parameters
    ----------
    motion : as its file has it.
    betas : (10,) shape in place of the file's.

    Raises
    ------
    DsnetError
        If it is not one of a body of a person's size.
    """
    if betas is not None:
        motion = replace(motion, betas=betas)
    elif {motion.gender, body.gender} == {"female", "male"}:
        file_gender = f"a {motion.gender}'s, the body {body.gender}"
        notify(f"the betas of {motion.source} are {file_gender}: see --betas")
    with np.errstate(over="ignore", invalid="ignore"):
        rest = body.v_template + body.shapedirs @ motion.betas
        size_m, far_m = np.ptp(rest, axis=0).max(), np.abs(unpack_theta(motion.theta)[1]).max()
    if not (size_m < LARGEST_BODY_M and far_m < FARTHEST_M):
        raise DsnetError(
            f"{motion.source}, a body of {size_m:.3g} m that moves {far_m:.3g} m off",
            f"a person within {FARTHEST_M:g} m of the origin",
            "Check the file's betas and trans; --betas gives another shape.",
        )
    return motion.about_root_joint((body.J_regressor @ rest)[0])


def load_motion(path: Path, body: BodyModelData, betas: NDArray[np.float64] | None) -> Motion:
    """Read an AMASS `.npz` or a BVH for a body; see `place_motion`.

    Raises
    ------
    DsnetError
        If the file is no motion, or not one of a body of a person's size.
    """
    return place_motion(load_motion_file(path), body, betas)
