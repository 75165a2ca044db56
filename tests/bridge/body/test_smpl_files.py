"""SMPL's files as licensed users have them, and every way in which a file can be bad."""

from __future__ import annotations

import os
import pickle
import struct
import sys
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

from bridge import DsnetError
from bridge.body import BodyModelData, load_body_model

Fields = dict[str, Any]


# The pickler in Python, unlike the one in C, lets a subclass choose opcodes.
PythonPickler: Any = pickle.__dict__["_Pickler"]


class Python2Pickler(PythonPickler):
    """Writes byte strings as Python 2 did: raw, to be read back as latin1 text."""

    dispatch = PythonPickler.dispatch.copy()

    def save_python2_string(self, data: bytes) -> None:
        self.write(pickle.BINSTRING + struct.pack("<i", len(data)) + data)
        self.memoize(data)

    dispatch[bytes] = save_python2_string


@pytest.fixture
def chumpy(monkeypatch: pytest.MonkeyPatch) -> types.SimpleNamespace:
    """Forged chumpy classes under the real module names, gone again before loading."""
    modules = {
        name: types.ModuleType(name) for name in ("chumpy", "chumpy.ch", "chumpy.reordering")
    }
    classes = {}
    for name, module in (("Ch", "chumpy.ch"), ("Select", "chumpy.reordering")):
        classes[name] = type(name, (), {"__module__": module})
        setattr(modules[module], name, classes[name])
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    return types.SimpleNamespace(**classes)


def instance(cls: type, **state: Any) -> Any:
    made = cls()
    made.__dict__.update(state, _dirty_vars=set(), _itr=None)
    return made


def python2_pickle(path: Path, fields: Any, protocol: int = 2) -> Path:
    """What SMPL's authors wrote: Python 2, old SciPy module names, `str` as bytes."""
    with path.open("wb") as file:
        Python2Pickler(file, protocol=protocol).dump(fields)
    path.write_bytes(path.read_bytes().replace(b"scipy.sparse._csc", b"scipy.sparse.csc"))
    return path


@pytest.fixture(scope="module")
def fields(female: BodyModelData) -> Fields:
    parents = np.where(female.parents < 0, 2**32 - 1, female.parents)
    return {
        "v_template": female.v_template,
        "f": female.faces.astype(np.uint32),
        "weights": female.weights,
        "shapedirs": female.shapedirs,
        "posedirs": female.posedirs.astype(np.float32),
        "J_regressor": sp.csc_matrix(female.J_regressor),
        "kintree_table": np.stack([parents, np.arange(24)]).astype(np.int64),
    }


def assert_same(loaded: BodyModelData, expected: BodyModelData) -> None:
    for name in ("v_template", "shapedirs", "weights", "faces", "parents"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(expected, name))
    np.testing.assert_allclose(loaded.posedirs, expected.posedirs, atol=1e-8)
    difference = loaded.J_regressor - expected.J_regressor
    assert np.abs(difference.toarray()).max() == 0.0


def test_python2_pickle_without_chumpy(
    fields: Fields, female: BodyModelData, tmp_path: Path
) -> None:
    loaded = load_body_model(
        python2_pickle(tmp_path / "basicModel_f_lbs_10_207_0_v1.0.0.pkl", fields)
    )
    assert_same(loaded, female)
    assert (loaded.source, loaded.gender) == ("licensed", "female")


@pytest.mark.parametrize("protocol", [1, 2])
def test_python2_pickle_with_chumpy(
    fields: Fields,
    female: BodyModelData,
    tmp_path: Path,
    chumpy: types.SimpleNamespace,
    monkeypatch: pytest.MonkeyPatch,
    protocol: int,
) -> None:
    """Vertices as a `Ch`, and the first 10 of 12 shape components as a `Select`."""
    many = np.concatenate([female.shapedirs, np.ones((6890, 3, 2))], axis=2)
    first_ten = np.arange(many.size).reshape(many.shape)[:, :, :10]
    selected = instance(
        chumpy.Select,
        a=instance(chumpy.Ch, x=many),
        idxs=first_ten.ravel(),
        preferred_shape=first_ten.shape,
    )
    forged = fields | {
        "v_template": instance(chumpy.Ch, x=female.v_template),
        "shapedirs": selected,
    }
    path = python2_pickle(tmp_path / "basicmodel_m_lbs.pkl", forged, protocol)
    assert b"chumpy.reordering" in path.read_bytes()
    for name in ("chumpy", "chumpy.ch", "chumpy.reordering"):
        monkeypatch.delitem(sys.modules, name)
    loaded = load_body_model(path)
    assert_same(loaded, female)
    assert loaded.gender == "male"


def test_300_shape_components_are_cut_to_10(
    fields: Fields, female: BodyModelData, tmp_path: Path
) -> None:
    many = np.zeros((6890, 3, 300), dtype=np.float32)
    many[:, :, :10] = female.shapedirs
    path = tmp_path / "SMPL_NEUTRAL.pkl"
    path.write_bytes(pickle.dumps(fields | {"shapedirs": many}, protocol=2))
    loaded = load_body_model(path)
    np.testing.assert_allclose(loaded.shapedirs, female.shapedirs, atol=1e-8)
    assert loaded.gender == "neutral"


def test_npz_with_dense_regressor(fields: Fields, female: BodyModelData, tmp_path: Path) -> None:
    path = tmp_path / "SMPL_FEMALE.npz"
    np.savez(path, **fields | {"J_regressor": fields["J_regressor"].toarray()})
    assert_same(load_body_model(path), female)


def test_npz_with_pickled_sparse_regressor(
    fields: Fields, female: BodyModelData, tmp_path: Path
) -> None:
    """`np.savez(**pickle)` stores the sparse matrix as an object array, hence as a pickle."""
    path = tmp_path / "SMPL_FEMALE.npz"
    np.savez(path, **fields)
    assert_same(load_body_model(path), female)


class Intruder:
    """Creates a file when it is unpickled."""

    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[str, int]]:
        return os.mkdir, (str(self.trace), 0o700)


def test_the_intruder_works_in_a_plain_unpickler(tmp_path: Path) -> None:
    pickle.loads(pickle.dumps(Intruder(tmp_path / "trace")))
    assert (tmp_path / "trace").exists()


@pytest.mark.parametrize("suffix", [".pkl", ".npz"])
def test_malicious_pickle_is_refused_and_not_run(
    fields: Fields, tmp_path: Path, suffix: str
) -> None:
    trace, path = tmp_path / "trace", tmp_path / f"model{suffix}"
    hostile: Fields = fields | {"J_regressor": Intruder(trace)}
    if suffix == ".pkl":
        path.write_bytes(pickle.dumps(hostile, protocol=2))
    else:
        np.savez(path, allow_pickle=True, **hostile)
    with pytest.raises(DsnetError, match=r"cannot be read safely .*it asks to run \w+\.mkdir"):
        load_body_model(path)
    assert not trace.exists()


@pytest.mark.parametrize(
    "payload",
    [
        b"cbuiltins\neval\n(S'1'\ntR.",
        b"cnumpy\nload\n(S'x'\ntR.",
        b"cnumpy.core.multiarray\nfromfile\n(S'x'\ntR.",
        b"ccopy_reg\n_reconstructor\n(cnumpy\nndarray\nc__builtin__\nobject\nNtR.",
        b"c_codecs\nencode\n(S'x'\nS'rot13'\ntR.",
        b"cscipy.sparse.csc\nos\n.",
    ],
)
def test_other_gadgets_are_refused(tmp_path: Path, payload: bytes) -> None:
    path = tmp_path / "model.pkl"
    path.write_bytes(payload)
    with pytest.raises(DsnetError, match="it asks"):
        load_body_model(path)


@pytest.mark.parametrize(
    "payload",
    [
        pytest.param(b"cnumpy\nndarray\n((L1000000000000000L\nttR.", id="petabytes"),
        pytest.param(b"(" * 5000, id="nested"),
        pytest.param(
            b"}S'v_template'\ncchumpy.ch\nCh\n)\x81p0\n}S'a'\ng0\nsS'idxs'\nI0\nsbs.", id="loop"
        ),
    ],
)
def test_exhausting_pickles_are_refused(tmp_path: Path, payload: bytes) -> None:
    path = tmp_path / "model.pkl"
    path.write_bytes(payload)
    with pytest.raises(DsnetError, match="cannot be read safely"):
        load_body_model(path)


def test_sparse_indices_out_of_range_are_refused(fields: Fields, tmp_path: Path) -> None:
    matrix = fields["J_regressor"].copy()
    matrix.indices[0] = 10**6
    path = tmp_path / "model.pkl"
    path.write_bytes(pickle.dumps(fields | {"J_regressor": matrix}, protocol=2))
    with pytest.raises(DsnetError, match="cannot be read safely"):
        load_body_model(path)


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
        ("weights", lambda a: np.zeros((6890, 52)), "weights has shape"),
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
    if suffix == ".npz":
        np.savez(path, **wrong)
    else:
        path.write_bytes(pickle.dumps(wrong, protocol=2))
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
def test_foreign_content_is_refused(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"model{suffix}"
    for content in (b"solid cube\n", pickle.dumps([1, 2, 3], protocol=2)):
        path.write_bytes(content)
        with pytest.raises(DsnetError, match="cannot be read safely"):
            load_body_model(path)
