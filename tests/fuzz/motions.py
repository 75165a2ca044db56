"""Damaged AMASS files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from hypothesis import strategies as st

from bridge.motion import load_amass_motion
from tests.forged import amass
from tests.fuzz.mutations import Draw, Files, damaged_npz


@st.composite
def files(draw: Draw) -> Files:
    forge = draw(st.sampled_from((amass.smplh, amass.smplx, amass.smpl)))
    arrays = {
        name: np.asarray(value)
        for name, value in forge(draw(st.integers(1, 6)), 60.0).items()
        if np.asarray(value).dtype != object
    }
    wanted = {"poses", "trans", "betas", "gender", "dmpls", "mocap_framerate", "mocap_frame_rate"}
    return {"motion.npz": draw(damaged_npz({n: a for n, a in arrays.items() if n in wanted}))}


def read(folder: Path) -> None:
    """As a motion at 60 fps."""
    load_amass_motion(folder / "motion.npz")
