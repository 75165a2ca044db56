"""Motions that nobody makes, in files that are whole, and files that declare too much."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bridge import DsnetError
from bridge.motion import load_amass_motion
from bridge.motion.bounds import MOST_FRAMES
from tests.forged.amass import save, smplh


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"poses": np.full((5, 156), 1e160)}, "turn a joint by 1e.160 rad.*Angles are radians"),
        ({"trans": np.full((5, 3), 1e39)}, "'trans' are 1e.39 m off.*convert it"),
        ({"trans": np.full((5, 3), 900.0)}, "it seems to be in millimetres"),
        ({"trans": np.full((5, 3), 90.0)}, "it seems to be in centimetres"),
        ({"betas": np.full(16, 1e10)}, "'betas' reach 1e.10"),
        ({"dmpls": np.zeros((5, 0))}, "'dmpls' have shape"),
        ({"poses": np.zeros((5, 0))}, "'poses' have shape"),
        ({"poses": np.zeros((3_000_000, 156), "i1")}, "'poses' is of|3000000 frames"),
        ({"gender": "female" * 10_000}, "'gender' is of 240000 bytes"),
    ],
)
def test_what_nobody_does_is_refused_by_name(
    tmp_path: Path, changes: dict[str, Any], complaint: str
) -> None:
    path = tmp_path / "motion.npz"
    np.savez_compressed(path, **(smplh() | changes))
    with pytest.raises(DsnetError, match=complaint) as caught:
        load_amass_motion(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("rate", "fps"), [(1.0, 60.0), (120.0, 1e9)])
def test_more_frames_than_a_file_may_make_are_not_made(
    tmp_path: Path, rate: float, fps: float
) -> None:
    path = save(tmp_path / "motion.npz", smplh(3000, rate), marker_data=None)
    with pytest.raises(DsnetError, match=f"expected at most {MOST_FRAMES}"):
        load_amass_motion(path, fps=fps)


@pytest.mark.parametrize("key", ["poses", "trans", "betas", "gender", "dmpls", "mocap_framerate"])
@pytest.mark.parametrize("content", [b"hello", b""])
def test_a_member_that_is_no_array_is_refused(tmp_path: Path, key: str, content: bytes) -> None:
    path = save(tmp_path / "motion.npz", smplh(), **{key: None})
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(f"{key}.npy", content)
    with pytest.raises(DsnetError, match="does not load"):
        load_amass_motion(path)


def test_a_directory_of_many_members_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "motion.npz"
    with zipfile.ZipFile(path, "w") as archive:
        for number in range(8000):
            archive.writestr(f"{number:0150}", b"")
    with pytest.raises(DsnetError, match="bytes at once"):
        load_amass_motion(path)


def test_what_is_no_file_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.npz")
    for path in (tmp_path / "pipe.npz", Path("/dev/zero"), tmp_path / ("x" * 5000)):
        with pytest.raises(DsnetError, match="does not load"):
            load_amass_motion(path)
