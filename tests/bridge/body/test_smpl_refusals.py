"""Every way in which a body model file can be wrong is told in one line; see also
`test_body_kinds`."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body import load_body_model
from tests.forged.bodies import fields_of, npz, person


def with_nan(array: np.ndarray) -> np.ndarray:
    return np.where(np.arange(array.size).reshape(array.shape) == 5, np.nan, array)


@pytest.mark.parametrize(
    ("field", "edit", "message"),
    [
        ("weights", None, "no field 'weights'"),
        ("kintree_table", None, "no field 'kintree_table'"),
        ("v_template", lambda a: a[:-1], r"weights has shape \(162, 24\)"),
        ("v_template", lambda a: a[0], "has shape"),
        ("f", lambda a: a[:, :2], r"f has shape .*expected shape \(any, 3\)"),
        ("shapedirs", lambda a: a[:, :, :0], "shapedirs has shape"),
        ("shapedirs", lambda a: a[0], r"shapedirs has shape \(3, 10\)"),
        ("shapedirs", lambda a: a.reshape(81, 60), r"shapedirs has shape \(81, 60\)"),
        ("posedirs", lambda a: a[:, :, :69], "posedirs has shape"),
        ("posedirs", lambda a: a.transpose(1, 0, 2), r"posedirs has shape \(3, 162, 207\)"),
        ("weights", lambda a: a[:, :23], "a skeleton of 23 joints"),
        ("weights", lambda a: np.pad(a, ((0, 0), (0, 28))), "posedirs has shape"),
        ("weights", lambda a: np.array(1.0), "weights has shape"),
        ("weights", lambda a: a + 0.5, "rows of weights miss a sum of 1"),
        ("v_template", with_nan, "v_template has 1 values that are NaN"),
        ("v_template", lambda a: a.astype("U8"), "not numeric"),
        ("f", lambda a: a + 1, "faces index vertices"),
        ("f", lambda a: a + 0.5, "f has fractions"),
        ("J_regressor", lambda a: a * 0.5, "rows of J_regressor"),
        ("posedirs", lambda a: np.where(a == a[0, 0, 0], np.inf, a), "posedirs has 1 values"),
        ("kintree_table", lambda a: a[::-1], "another skeleton"),
        ("kintree_table", lambda a: np.where(a == 3, 7, a), "another skeleton"),
    ],
)
@pytest.mark.parametrize("suffix", [".npz", ".pkl"])
def test_wrong_fields_are_named(
    tmp_path: Path, suffix: str, field: str, edit: Any, message: str
) -> None:
    wrong = fields_of(person())
    value = wrong.pop(field)
    if edit is not None:
        wrong[field] = edit(value)
    path = tmp_path / f"model{suffix}"
    path.write_bytes(npz(wrong) if suffix == ".npz" else pickle.dumps(wrong, protocol=2))
    with pytest.raises(DsnetError, match=message) as caught:
        load_body_model(path)
    assert "\n" not in str(caught.value)


def test_missing_file_and_no_files_are_told(tmp_path: Path) -> None:
    with pytest.raises(DsnetError, match="no such file"):
        load_body_model(tmp_path / "absent.pkl")
    with pytest.raises(DsnetError, match="a folder without a body model"):
        load_body_model(tmp_path)


@pytest.mark.parametrize("suffix", [".npz", ".pkl"])
@pytest.mark.parametrize("kept", [0, 1, 10, 0.5, 0.999])
def test_truncated_files_are_refused(tmp_path: Path, suffix: str, kept: float) -> None:
    path = tmp_path / f"model{suffix}"
    getattr(person("smplh"), f"save_smpl_{suffix[1:]}")(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(kept * len(whole)) if kept < 1 else int(kept)])
    with pytest.raises(DsnetError, match=r"cut short|empty file|of no kind"):
        load_body_model(path)
