"""Arrays from what a pickle describes of them: no constructor sees a value that was not checked."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pickle import UnpicklingError
from typing import Any, Literal

import numpy as np
import scipy.sparse as sp

from bridge.runs.untrusted import text_of

MOST_BYTES = 1 << 29
"""Of an array in a body's file: SMPL-X's pose blend shapes take 122 MB, those of SMPL's surface cut
four times as fine 137."""
_MOST_MADE_BYTES = 1 << 27
"""Of an array that is larger than what the file has of it: a sparse matrix, or a choice."""
_NUMBERS = re.compile(r"[biuf][1248]|[SU]\d{1,4}")


@dataclass(eq=False)
class Record:
    """An object that a pickle describes, kept as its bare state."""

    kind: str
    arguments: tuple[Any, ...] = ()
    state: Any = None


def as_array(value: Any) -> np.ndarray:
    """A dense array from what a pickle's field held: one of the records, or a number.

    Raises an exception of any kind, if it is something else: lists can hold one another a million
    times over.
    """
    if isinstance(value, (np.ndarray, float)):
        return np.asarray(value)
    match value:
        case Record("array") | Record("buffer"):
            shape, dtype, order, raw = array_parts(value)
            sizes = whole_numbers(shape)
            if holds_objects(dtype):
                return _of_objects(raw, sizes)
            numbers = dtype_of(dtype)
            _check_size(sizes, numbers.itemsize, MOST_BYTES)
            flat = np.frombuffer(_raw_bytes(raw), numbers, math.prod(sizes))
            if isinstance(order, tuple):
                return flat.reshape(sizes).transpose(order)
            return flat.reshape(sizes, order=order)
        case Record("scalar", (Record("dtype") as dtype, raw)):
            return np.frombuffer(_raw_bytes(raw), dtype_of(dtype), 1).reshape(())
        case Record("chumpy", _, {"idxs": idxs, "a": whole, **state}):
            # A chumpy.reordering.Select. `idxs` may repeat what there is.
            indices = as_array(idxs)
            _check_size(indices.shape, 8)
            selected, shape = as_array(whole).ravel()[indices], state.get("preferred_shape")
            return selected if shape is None else selected.reshape(shape)
        case Record("chumpy", _, {"x": x}):
            return as_array(x)
        case Record("csc" | "csr" | "coo", _, dict(state)):
            return _dense(value.kind, state)
    raise UnpicklingError(f"a {type(value).__name__} in place of an array")


def plain_text(value: Any) -> Any:
    """The text that one of NumPy's strings is; anything else as it is."""
    if isinstance(value, Record) and value.kind == "scalar":
        scalar = as_array(value)
        return text_of(scalar) if scalar.dtype.kind in "US" else value
    return value


def holds_objects(dtype: Record) -> bool:
    return dtype.arguments[0] in ("O8", "O4", "O")


def _of_objects(items: Any, sizes: tuple[int, ...]) -> np.ndarray:
    """Numbers that were stored as objects, one by one."""
    numbers = isinstance(items, list) and all(isinstance(item, (int, float)) for item in items)
    if not numbers or len(items) != math.prod(sizes):
        raise UnpicklingError("an array of neither numbers nor text")
    return np.array(items, np.float64).reshape(sizes)


def _dense(kind: str, state: dict[Any, Any]) -> np.ndarray:
    """What a sparse matrix of any SciPy stands for."""
    shape = whole_numbers(state.get("_shape", state.get("shape")))
    if len(shape) != 2:
        raise UnpicklingError("a matrix that is none")
    _check_size(shape, 8)
    numbers = as_array(state["data"]).astype(np.float64)
    if kind == "coo":
        places = state.get("coords") or (state["row"], state["col"])
        rows, columns = (as_array(indices) for indices in places)
        return sp.coo_matrix((numbers, (rows, columns)), shape=shape).toarray()
    made = sp.csc_matrix if kind == "csc" else sp.csr_matrix
    indices, pointers = (as_array(state[key]) for key in ("indices", "indptr"))
    matrix = made((numbers, indices, pointers), shape=shape)
    matrix.check_format(full_check=True)  # SciPy's routines trust indices
    return matrix.toarray()


def array_parts(
    record: Record,
) -> tuple[Any, Record, Literal["C", "F"] | tuple[int, ...], Any]:
    """Shape, dtype, the order of what is stored or how its axes are transposed, and that."""
    match record.kind, record.state, record.arguments:
        case "array", (_, shape, Record("dtype") as dtype, is_fortran, raw), _:
            return shape, dtype, "F" if is_fortran else "C", raw
        case "buffer", None, (raw, Record("dtype") as dtype, shape, ("C" | "F") as order):
            return shape, dtype, order, raw  # protocol 5
        case "buffer", None, (raw, Record("dtype") as dtype, shape, "K", axes):  # from NumPy 2.4
            return shape, dtype, whole_numbers(axes), raw
    raise UnpicklingError("an array without its values")


def dtype_of(record: Record) -> np.dtype:
    """Of numbers or text."""
    code, order = record.arguments[0], "|"
    if record.state is not None:
        _, order, *parts = record.state
        if any(part is not None for part in parts[:3]):
            raise UnpicklingError("an array of structures")
    if not isinstance(code, str) or not _NUMBERS.fullmatch(code) or order not in set("<>=|"):
        raise UnpicklingError("an array of neither numbers nor text")
    return np.dtype(code).newbyteorder(order)


def whole_numbers(shape: Any) -> tuple[int, ...]:
    if (
        not isinstance(shape, (tuple, list))
        or len(shape) > 8
        or not all(type(size) is int and size >= 0 for size in shape)
    ):
        raise UnpicklingError("a shape that is none")
    return tuple(shape)


def _check_size(shape: tuple[int, ...], item_bytes: int, most: int = _MOST_MADE_BYTES) -> None:
    if math.prod(shape) * max(item_bytes, 1) > most:
        raise UnpicklingError(f"an array of shape {shape}")


def _raw_bytes(raw: Any) -> bytes | bytearray:
    if not isinstance(raw, (str, bytes, bytearray)):
        raise UnpicklingError(f"a {type(raw).__name__} in place of an array's values")
    return raw.encode("latin1") if isinstance(raw, str) else raw
