"""Bodies that no person has, in files that are whole, and files that declare too much."""

from __future__ import annotations

import io
import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body import BodyModelData, load_body_model
from bridge.body.body_checks import checked_person
from bridge.body.smpl_files import load_smpl_file
from tests.forged.smpl import Fields, npz, smpl_fields


@pytest.fixture(scope="module")
def fields(female: BodyModelData) -> Fields:
    """Blend shapes are zeros of one byte: a tenth of the time."""
    made = smpl_fields(female)
    small = {"shapedirs": np.zeros((6890, 3, 10), "i1"), "posedirs": np.zeros((6890, 3, 207), "i1")}
    return made | small | {"J_regressor": made["J_regressor"].toarray()}


def _uneven(weights: np.ndarray) -> np.ndarray:
    return weights + np.where(np.arange(24) < 2, [-5.0, 5.0] + [0.0] * 22, 0.0)


@pytest.mark.parametrize(
    ("edits", "complaint"),
    [
        ({"v_template": lambda v: v * 1000}, "seems to be in millimetres"),
        ({"v_template": lambda v: v * 100}, "seems to be in centimetres"),
        ({"v_template": lambda v: v * 1e39}, "Convert it to metres"),
        ({"v_template": lambda v: v * 0}, "a body of 0; expected a person in metres"),
        ({"v_template": lambda v: v[:, [0, 2, 1]] * [1, -1, 1]}, "y up, facing z"),
        ({"v_template": lambda v: v * [-1, 1, 1]}, "It is mirrored"),
        ({"v_template": lambda v: v * [-1, 1, -1]}, "or faces -z"),
        ({"weights": _uneven}, "skinning weights of -5"),
        ({"posedirs": lambda p: p + 1e300}, "posedirs that move a vertex by 1e.300 m"),
        ({"shapedirs": lambda p: p + 5}, "shapedirs that move a vertex by 5 m"),
        ({"J_regressor": lambda j: j * 1e6 - (1e6 - 1) / 6890}, "outside of the body"),
        ({"f": lambda f: f + 0.25}, "f has fractions"),
        ({"kintree_table": lambda k: k + 0.5}, "kintree_table has fractions"),
    ],
)
def test_who_is_no_person_is_refused_by_name(
    fields: Fields, tmp_path: Path, edits: dict[str, Callable], complaint: str
) -> None:
    path = tmp_path / "model.npz"
    changed = {name: edit(fields[name].astype(np.float64)) for name, edit in edits.items()}
    path.write_bytes(npz(fields | changed))
    with pytest.raises(DsnetError, match=complaint):
        load_smpl_file(path)


def test_the_embedded_bodies_are_persons(body: BodyModelData) -> None:
    assert checked_person(body) is body


@pytest.mark.parametrize("kind", [">f8", "f2"])
def test_regressors_of_every_float_type_are_read(
    fields: Fields, female: BodyModelData, tmp_path: Path, kind: str
) -> None:
    path = tmp_path / "model.npz"
    # Of one sign, as SMPL's: the embedded body's cancel, and half precision would miss the sum.
    regressor = np.maximum(female.J_regressor.toarray(), 0.0)
    regressor /= regressor.sum(axis=1, keepdims=True)
    path.write_bytes(npz(fields | {"J_regressor": regressor.astype(kind)}))
    found = load_smpl_file(path).J_regressor
    np.testing.assert_allclose(found.toarray(), regressor, atol=1e-3)


def _with_header(**changes: Any) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        stream, {"descr": "|i1", "fortran_order": False, "shape": (1,)} | changes
    )
    return stream.getvalue()


@pytest.mark.parametrize(
    ("member", "complaint"),
    [
        (_with_header(shape=(6890, 3, 100_000)), "'posedirs' is of 2067000000 bytes"),
        (_with_header(shape=(2**32, 2**32)), "'posedirs' is of 18446744073709551616 bytes"),
        (_with_header(shape=(-1, 3)), "none of a .npy"),
        (_with_header(descr="|V8"), "'posedirs' is an array of"),
        (_with_header(descr="|S9999999999"), "none of a .npy"),
        (_with_header()[:60], "none of a .npy"),
        (b"hello", "none of a .npy"),
        (b"", "none of a .npy"),
    ],
)
def test_what_a_member_declares_is_checked_before_it_is_read(
    fields: Fields, tmp_path: Path, member: bytes, complaint: str
) -> None:
    path = tmp_path / "model.npz"
    path.write_bytes(npz({name: fields[name] for name in fields if name != "posedirs"}))
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("posedirs.npy", member)
    with pytest.raises(DsnetError, match=f"cannot be read safely .*{complaint}"):
        load_smpl_file(path)


@pytest.mark.parametrize("kind", [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_compression_that_declares_its_own_memory_is_refused(
    fields: Fields, tmp_path: Path, kind: int
) -> None:
    path = tmp_path / "model.npz"
    with zipfile.ZipFile(path, "w", kind) as archive:
        archive.writestr("f.npy", npz({"f": fields["f"]})[:1000])
    with pytest.raises(DsnetError, match="compressed in another way"):
        load_smpl_file(path)


def test_a_member_elsewhere_is_not_taken_for_one_here(fields: Fields, tmp_path: Path) -> None:
    path = tmp_path / "model.npz"
    stream = io.BytesIO(npz(fields))
    with zipfile.ZipFile(stream) as whole, zipfile.ZipFile(path, "w") as archive:
        for name in whole.namelist():
            prefix = "../../" if name == "v_template.npy" else ""
            archive.writestr(prefix + name, whole.read(name))
    with pytest.raises(DsnetError, match="no field 'v_template'"):
        load_smpl_file(path)


@pytest.mark.parametrize("suffix", [".npz", ".pkl"])
def test_what_is_no_file_is_refused_at_once(tmp_path: Path, suffix: str) -> None:
    os.mkfifo(pipe := tmp_path / f"pipe{suffix}")
    (device := tmp_path / f"device{suffix}").symlink_to("/dev/zero")
    for path in (pipe, device, tmp_path / f"{'x' * 5000}{suffix}", tmp_path / f"a\0b{suffix}"):
        with pytest.raises(DsnetError, match="cannot be read safely"):
            load_body_model(path)
