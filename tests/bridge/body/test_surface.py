"""Faces that are no closed surface are refused, each with its reason."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body import BodyModelData, load_body_model
from bridge.body.smpl_files import checked_surface


def flip_first(faces: np.ndarray) -> np.ndarray:
    return np.concatenate([faces[:1, ::-1], faces[1:]])


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (np.zeros_like, "13776 faces that repeat a vertex"),
        (lambda faces: faces[:-1], "leave holes"),
        (lambda faces: faces[:, ::-1], "clockwise seen from outside"),
        (flip_first, "wind in opposite directions"),
    ],
)
def test_what_is_no_closed_surface_is_refused(
    female: BodyModelData, edit: Callable[[np.ndarray], np.ndarray], words: str
) -> None:
    with pytest.raises(DsnetError, match=words):
        checked_surface(replace(female, faces=edit(female.faces)))


def test_a_file_is_checked_when_it_is_loaded(female: BodyModelData, tmp_path: Path) -> None:
    assert checked_surface(female) is female
    replace(female, faces=female.faces[:, ::-1]).save_smpl_npz(tmp_path / "inside_out.npz")
    with pytest.raises(DsnetError, match=r"inside_out\.npz: faces that wind clockwise"):
        load_body_model(tmp_path / "inside_out.npz")
