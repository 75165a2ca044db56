"""Every way in which a body model file can be wrong is told in one line."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body import BodyModelData, load_body_model
from tests.forged.smpl import Fields, npz, smpl_fields


@pytest.fixture(scope="module")
def fields(female: BodyModelData) -> Fields:
    made = smpl_fields(female)
    return made | {"J_regressor": made["J_regressor"].toarray()}


def with_nan(array: np.ndarray) -> np.ndarray:
    return np.where(np.arange(array.size).reshape(array.shape) == 5, np.nan, array)


@pytest.mark.parametrize(
    ("field", "edit", "message"),
    [
        ("weights", None, "no field 'weights'"),
        ("kintree_table", None, "no field 'kintree_table'"),
        ("v_template", lambda a: a[:6889], r"v_template has shape \(6889, 3\)"),
        ("f", lambda a: a[:100], r"f has shape \(100, 3\); expected shape \(13776, 3\)"),
        ("shapedirs", lambda a: a[:, :, :9], r"shapedirs .*expected shape \(6890, 3, >= 10\)"),
        ("shapedirs", lambda a: a[0], r"shapedirs has shape \(3, 10\)"),
        ("posedirs", lambda a: a[:, :, :69], "posedirs has shape"),
        ("weights", lambda a: np.zeros((6890, 23)), "weights has shape"),
        ("weights", lambda a: np.zeros((6890, 52)), "SMPL-H's; expected SMPL's own"),
        ("weights", lambda a: np.zeros((10475, 55)), "SMPL-X's; expected SMPL's own"),
        ("weights", lambda a: np.array(1.0), "weights has shape"),
        ("v_template", with_nan, "v_template has 1 values that are NaN"),
        ("v_template", lambda a: a.astype("U8"), "not numeric"),
        ("f", lambda a: a + 1, "faces index vertices"),
        ("kintree_table", lambda a: a[::-1], "parents are"),
    ],
)
@pytest.mark.parametrize("suffix", [".npz", ".pkl"])
def test_wrong_fields_are_named(
    fields: Fields, tmp_path: Path, suffix: str, field: str, edit: Any, message: str
) -> None:
    wrong = dict(fields)
    value = wrong.pop(field)
    if edit is not None:
        wrong[field] = edit(value)
    path = tmp_path / f"model{suffix}"
    path.write_bytes(npz(wrong) if suffix == ".npz" else pickle.dumps(wrong, protocol=2))
    with pytest.raises(DsnetError, match=message) as caught:
        load_body_model(path)
    assert "\n" not in str(caught.value)


def test_missing_file_folder_and_foreign_type(tmp_path: Path) -> None:
    (tmp_path / "model.txt").write_text("hello")
    for path, message in (
        (tmp_path / "absent.pkl", "no such file"),
        (tmp_path, "a folder"),
        (tmp_path / "model.txt", "a file of type .txt; expected .npz or .pkl"),
    ):
        with pytest.raises(DsnetError, match=message):
            load_body_model(path)


@pytest.mark.parametrize("suffix", [".npz", ".pkl"])
@pytest.mark.parametrize("kept", [0, 10, 0.5, 0.999])
def test_truncated_files_are_refused(
    female: BodyModelData, tmp_path: Path, suffix: str, kept: float
) -> None:
    path = tmp_path / f"model{suffix}"
    getattr(female, f"save_smpl_{suffix[1:]}")(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(kept * len(whole)) if kept < 1 else int(kept)])
    with pytest.raises(DsnetError, match="cannot be read safely"):
        load_body_model(path)


@pytest.mark.parametrize("suffix", [".npz", ".pkl"])
@pytest.mark.parametrize(
    "content",
    [
        pytest.param(b"<!DOCTYPE html>\n<title>Log in</title>\n", id="a login page"),
        pytest.param(pickle.dumps([1, 2, 3], protocol=2), id="a list"),
        pytest.param(b"PK\x05\x06" + bytes(18), id="an empty archive"),
    ],
)
def test_foreign_content_is_refused(tmp_path: Path, suffix: str, content: bytes) -> None:
    path = tmp_path / f"model{suffix}"
    path.write_bytes(content)
    with pytest.raises(DsnetError, match=r"cannot be read safely|no field") as caught:
        load_body_model(path)
    assert "\n" not in str(caught.value)
