"""Damaged AMASS files, BVH's and DMPL's."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from hypothesis import strategies as st

from bridge.body import load_body_model
from bridge.body.containers import load_dmpl_directions
from bridge.body.model_data import SMPL_JOINT_NAMES, SMPL_PARENTS
from bridge.motion import load_motion
from tests.forged import amass, bvh
from tests.forged.motion_kinds import KINDS
from tests.fuzz.mutations import Draw, Files, damaged, damaged_npz

_BODY = load_body_model("embedded:female")


@st.composite
def files(draw: Draw) -> Files:
    """AMASS's in most cases, else pickles, torch files, places of joints and other arrays."""
    if draw(st.integers(0, 2)) == 0:
        return draw(_damaged_kinds({".npz", ".smpl", ".pkl", ".pt", ".npy"}))
    forge = draw(st.sampled_from((amass.smplh, amass.smplx, amass.smpl)))
    arrays = {
        name: np.asarray(value)
        for name, value in forge(draw(st.integers(1, 6)), 60.0).items()
        if np.asarray(value).dtype != object
    }
    wanted = {"poses", "trans", "betas", "gender", "dmpls", "mocap_framerate", "mocap_frame_rate"}
    return {"motion.npz": damaged_npz(draw, {n: a for n, a in arrays.items() if n in wanted})}


def read(folder: Path) -> None:
    """As a motion at 60 fps, at a rate that the user says."""
    (path,) = folder.iterdir()
    load_motion(path, 60.0)


@st.composite
def dmpl_files(draw: Draw) -> Files:
    """Of few vertices in most cases: what is declared is looked at first."""
    vertices = draw(st.sampled_from((6890, 12, 0)))
    count = draw(st.integers(0, 9))
    directions = np.linspace(-1, 1, vertices * 3 * count).reshape(vertices, 3, count) ** 3
    return {"model.npz": damaged_npz(draw, {"eigvec": directions})}


def read_dmpl(folder: Path) -> None:
    """Its directions."""
    load_dmpl_directions(folder / "model.npz")


@st.composite
def bvh_files(draw: Draw) -> Files:
    """Of SMPL's skeleton, or of one whose joints are called otherwise; some with all positions; and
    of every kind."""
    if draw(st.booleans()):
        return draw(_damaged_kinds({".bvh"}))
    frames = draw(st.integers(1, 4))
    rest = _BODY.J_regressor @ _BODY.v_template
    names = draw(st.sampled_from((SMPL_JOINT_NAMES, [f"joint{n}" for n in range(24)])))
    turns = np.broadcast_to(np.eye(3), (frames, 24, 3, 3))
    skeleton = bvh.Skeleton(names, SMPL_PARENTS, rest)
    places = draw(st.sampled_from((None, np.tile(rest, (frames, 1, 1)))))
    whole = bvh.text(skeleton, turns, np.zeros((frames, 3)), places=places)
    return {"motion.bvh": damaged(draw, whole.encode())}


@st.composite
def _damaged_kinds(draw: Draw, suffixes: set[str]) -> Files:
    names = [kind.file for kind in KINDS if Path(kind.file).suffix in suffixes]
    name = draw(st.sampled_from(names))
    return {name: damaged(draw, _whole(name))}


@cache
def _whole(name: str) -> bytes:
    (kind,) = (kind for kind in KINDS if kind.file == name)
    with tempfile.TemporaryDirectory() as folder:
        return kind.write(Path(folder)).read_bytes()
