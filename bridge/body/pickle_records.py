"""What the pickles of SMPL describe, as inert records, and arrays made of them.

No constructor of NumPy's, SciPy's or Python's sees a file's values: a record keeps them, and what
it holds is checked when an array is wanted.
"""

from __future__ import annotations

import math
import pickle
import re
from typing import Any

import numpy as np
import scipy.sparse as sp

MOST_BYTES = 1 << 27
"""Of an array in a file of SMPL's: 300 shape components take 50 MB."""
_NUMBERS = re.compile(r"[biuf][1248]|[SU]\d{1,4}")


class Record:
    """An object that a pickle describes, kept as its bare state."""

    state: Any = None

    def __init__(self, *arguments: Any) -> None:
        self.arguments = arguments


class ChumpyRecord(Record):
    """State of a chumpy object; `to_array` evaluates the two kinds that SMPL files use."""

    def to_array(self) -> np.ndarray:
        """Value of a `chumpy.Ch` (its `x`) or a `chumpy.reordering.Select` (`a` at `idxs`).

        Raises
        ------
        pickle.UnpicklingError
            If the record is of another kind.
        """
        state = _fields(self)
        if "idxs" in state and "a" in state:
            indices = as_array(state["idxs"])
            _check_size(indices.shape, 8)
            selected = as_array(state["a"]).ravel()[indices]
            shape = state.get("preferred_shape")
            return selected if shape is None else selected.reshape(shape)
        if "x" in state:
            return as_array(state["x"])
        raise pickle.UnpicklingError("a chumpy object that is neither a constant nor a slice")


class CscRecord(Record):
    """State of a `scipy.sparse.csc_matrix`, of whatever SciPy version."""

    def to_array(self) -> np.ndarray:
        """The matrix, dense; its indices are checked, because SciPy's routines trust them."""
        state = _fields(self)
        shape = _whole_numbers(state.get("_shape", state.get("shape")))
        _check_size(shape, 8)
        data, *indices = (as_array(state[key]) for key in ("data", "indices", "indptr"))
        matrix = sp.csc_matrix((data.astype(np.float64), *indices), shape=shape)
        matrix.check_format(full_check=True)
        return matrix.toarray()


class DtypeRecord(Record):
    """Arguments and state of a `numpy.dtype`."""

    def to_dtype(self) -> np.dtype:
        """The type, if it is one of numbers or text."""
        code, order = self.arguments[0], "|"
        if self.state is not None:
            _, order, *parts = self.state
            if any(part is not None for part in parts[:3]):
                raise pickle.UnpicklingError("an array of structures")
        if not isinstance(code, str) or not _NUMBERS.fullmatch(code) or order not in set("<>=|"):
            raise pickle.UnpicklingError("an array of neither numbers nor text")
        return np.dtype(code).newbyteorder(order)


class ArrayRecord(Record):
    """State of a `numpy.ndarray`."""

    def to_array(self) -> np.ndarray:
        """The array, a view of the bytes that were read."""
        shape, dtype, is_fortran, raw = self._parts()
        shape, dtype = _whole_numbers(shape), dtype.to_dtype()
        _check_size(shape, dtype.itemsize)
        flat = np.frombuffer(_raw_bytes(raw), dtype, math.prod(shape))
        return flat.reshape(shape, order="F" if is_fortran else "C")

    def only_item(self) -> Any:
        """What an array of one object holds, as NumPy stores what is no array in an `.npz`."""
        shape, dtype, _, items = self._parts()
        if shape != () or dtype.arguments[0] not in ("O8", "O4") or not isinstance(items, list):
            raise pickle.UnpicklingError("an array of objects")
        (item,) = items
        return item

    def _parts(self) -> tuple[Any, DtypeRecord, Any, Any]:
        if not isinstance(self.state, tuple) or len(self.state) != 5:
            raise pickle.UnpicklingError("an array without its values")
        _, shape, dtype, is_fortran, raw = self.state
        if not isinstance(dtype, DtypeRecord):
            raise pickle.UnpicklingError("an array without a type")
        return shape, dtype, is_fortran, raw


class ScalarRecord(Record):
    """Arguments of NumPy's `scalar`: a type and its bytes."""

    def to_array(self) -> np.ndarray:
        """The number as an array without axes."""
        dtype, raw = self.arguments
        return np.frombuffer(_raw_bytes(raw), dtype.to_dtype(), 1).reshape(())


def as_array(value: Any) -> np.ndarray:
    """A dense array from what a pickle's field held: one of the records, or a number.

    Raises
    ------
    Exception
        Of any kind, if it is something else: lists can hold one another a million times over.
    """
    if isinstance(value, (ChumpyRecord, CscRecord, ArrayRecord, ScalarRecord)):
        return value.to_array()
    if isinstance(value, (np.ndarray, float)):
        return np.asarray(value)
    raise pickle.UnpicklingError(f"a {type(value).__name__} in place of an array")


def _fields(record: Record) -> dict[str, Any]:
    if not isinstance(record.state, dict):
        raise pickle.UnpicklingError(f"an object state of type {type(record.state).__name__}")
    return record.state


def _whole_numbers(shape: Any) -> tuple[int, ...]:
    if not isinstance(shape, (tuple, list)) or len(shape) > 8:
        raise pickle.UnpicklingError("a shape that is none")
    if not all(type(size) is int and size >= 0 for size in shape):
        raise pickle.UnpicklingError("a shape that is none")
    return tuple(shape)


def _check_size(shape: tuple[int, ...], item_bytes: int) -> None:
    if math.prod(shape) * max(item_bytes, 1) > MOST_BYTES:
        raise pickle.UnpicklingError(f"an array of shape {shape}")


def _raw_bytes(raw: Any) -> bytes:
    if not isinstance(raw, (str, bytes)):
        raise pickle.UnpicklingError(f"a {type(raw).__name__} in place of an array's values")
    return raw.encode("latin1") if isinstance(raw, str) else raw
