"""SMPL's and DMPL's files as licensed users have them, forged; whatever else is refused."""

from __future__ import annotations

import io
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body import BodyModelData, load_body_model
from bridge.body.body_checks import checked_surface
from bridge.body.containers import load_dmpl_directions
from bridge.body.pickled_arrays import as_array
from bridge.body.safe_pickle import load_restricted
from tests.forged.dmpl import forged_directions, save_dmpl
from tests.forged.python2_pickle import Ch, Select, python2_pickle, sliced
from tests.forged.smpl import npz, smpl_fields


@pytest.mark.parametrize(
    "turn",
    [
        np.transpose,
        lambda array: np.moveaxis(array, -1, 0),
        lambda array: array.reshape(-1, array.shape[-1]).T,
    ],
)
def test_directions_turned_over_are_turned_back(
    female: BodyModelData, tmp_path: Path, turn: Callable[[np.ndarray], np.ndarray]
) -> None:
    fields = smpl_fields(female)
    for name in ("shapedirs", "posedirs"):
        fields[name] = turn(np.asarray(fields[name]))
    np.savez(tmp_path / "SMPL_FEMALE.npz", **fields)
    found = load_body_model(tmp_path / "SMPL_FEMALE.npz")
    np.testing.assert_allclose(found.shapedirs, female.shapedirs, atol=1e-8)
    np.testing.assert_allclose(found.posedirs, female.posedirs, atol=1e-8)


@pytest.mark.parametrize("protocol", [0, 1, 2])
@pytest.mark.parametrize("inner", [Ch, lambda array: Ch(Ch(array)), lambda array: array])
def test_a_select_is_its_arrays_elements(protocol: int, inner: Any) -> None:
    array = np.arange(24.0).reshape(2, 3, 4)
    nested = sliced(sliced(inner(array), (2, 3, 4), 3), (2, 3, 3), 2)
    flat = Select(inner(array), np.array([5, 0]), preferred_shape=(2,))
    loaded = load_restricted(io.BytesIO(python2_pickle([nested, flat], protocol)))
    np.testing.assert_array_equal(as_array(loaded[0]), array[:, :, :2])
    np.testing.assert_array_equal(as_array(loaded[1]), [5, 0])


class _AsOfNumPy24:
    """Is pickled as an array is by NumPy 2.4 if its axes lie in memory neither as in C nor as in
    Fortran: with their order."""

    def __init__(self, in_memory: np.ndarray, axes: tuple[int, ...]) -> None:
        self.in_memory, self.axes = in_memory, axes

    def __reduce__(self) -> tuple[Any, ...]:
        array = self.in_memory
        from_buffer = np.ndarray.__reduce_ex__(array, 5)[0]
        return from_buffer, (bytearray(array.tobytes()), array.dtype, array.shape, "K", self.axes)


@pytest.mark.parametrize("order", ["C", "F", "K"])
def test_an_array_of_protocol_5_has_its_axes(order: Literal["C", "F", "K"]) -> None:
    in_memory = np.arange(24.0).reshape(2, 3, 4)
    array = in_memory.transpose(1, 2, 0) if order == "K" else np.asarray(in_memory, order=order)
    stored = _AsOfNumPy24(in_memory, (1, 2, 0)) if order == "K" else array
    loaded = load_restricted(io.BytesIO(pickle.dumps(stored, 5)))
    np.testing.assert_array_equal(as_array(loaded), array)


@pytest.mark.parametrize("axes", [(0, 0, 1), (0, 1), (0, 1, 3), 5, ("x", "y", "z")])
def test_axes_that_are_none_are_refused(axes: Any) -> None:
    stored = _AsOfNumPy24(np.zeros((2, 3, 4)), axes)
    with pytest.raises((pickle.UnpicklingError, ValueError)):
        as_array(load_restricted(io.BytesIO(pickle.dumps(stored, 5))))


@pytest.mark.parametrize(
    ("path", "gender"),
    [
        ("basicmodel_m_lbs_10_207_0_v1.0.0.npz", "male"),
        ("basicModel_f_lbs_10_207_0_v1.0.0.npz", "female"),
        ("basicmodel_neutral_lbs_10_207_0_v1.1.0.npz", "neutral"),
        ("SMPL_MALE.npz", "male"),
        ("smpl-female.npz", "female"),
        ("male/model.npz", "male"),
        ("female/SMPL_NEUTRAL.npz", "neutral"),
        ("models/model.npz", "unknown"),
    ],
)
def test_gender_is_read_from_the_path(
    female: BodyModelData, tmp_path: Path, path: str, gender: str
) -> None:
    file = tmp_path / path
    file.parent.mkdir(exist_ok=True)
    fields = smpl_fields(female)
    file.write_bytes(npz(fields | {"J_regressor": fields["J_regressor"].toarray()}))
    assert load_body_model(file).gender == gender


def test_the_first_eight_are_read(tmp_path):
    path = save_dmpl(tmp_path / "model.npz", count=10)
    np.testing.assert_array_equal(load_dmpl_directions(path), forged_directions(10)[..., :8])


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"dirs": forged_directions()}, "no 'eigvec'"),
        ({"eigvec": forged_directions(7)}, r"in shape \(6890, 3, 7\)"),
        ({"eigvec": forged_directions()[:6889]}, r"in shape \(6889, 3, 8\)"),
        ({"eigvec": np.repeat(forged_directions(1), 8, axis=2)}, "parallel"),
        ({"eigvec": np.full((6890, 3, 8), np.nan)}, "not numbers"),
        ({"eigvec": np.array([None])}, "array of object"),
    ],
)
def test_what_is_none_is_refused(tmp_path, fields, words):
    np.savez(tmp_path / "model.npz", **fields)
    with pytest.raises(DsnetError, match=words):
        load_dmpl_directions(tmp_path / "model.npz")


def test_no_file_and_half_a_file_are_refused(tmp_path):
    path = tmp_path / "model.npz"
    with pytest.raises(DsnetError, match="DMPL"):
        load_dmpl_directions(path)
    save_dmpl(path)
    path.write_bytes(path.read_bytes()[:100_000])
    with pytest.raises(DsnetError, match="DMPL"):
        load_dmpl_directions(path)


def flip_first(faces: np.ndarray) -> np.ndarray:
    return np.concatenate([faces[:1, ::-1], faces[1:]])


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (np.zeros_like, "13776 faces that repeat a vertex"),
        (lambda faces: faces[::2], "leave holes, along [0-9]+ of [0-9]+ edges"),
        (lambda faces: faces[faces.max(axis=1) < 6000], "[0-9]+ vertices without a face"),
        (lambda faces: faces[:, ::-1], "clockwise seen from outside"),
        (flip_first, "wind in opposite directions"),
    ],
)
def test_what_is_no_skin_is_refused(
    female: BodyModelData, edit: Callable[[np.ndarray], np.ndarray], words: str
) -> None:
    with pytest.raises(DsnetError, match=words):
        checked_surface(replace(female, faces=edit(female.faces)))


def test_a_file_is_checked_when_it_is_loaded(female: BodyModelData, tmp_path: Path) -> None:
    assert checked_surface(female) is female
    open_ = replace(female, faces=female.faces[:-20])
    assert checked_surface(open_) is open_
    assert open_.texture is None
    replace(female, faces=female.faces[:, ::-1]).save_smpl_npz(tmp_path / "inside_out.npz")
    with pytest.raises(DsnetError, match=r"inside_out\.npz: faces that wind clockwise"):
        load_body_model(tmp_path / "inside_out.npz")
