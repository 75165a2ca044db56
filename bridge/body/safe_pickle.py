"""Read SMPL's pickles without running anything that they contain.

The licensed files were pickled by Python 2 and hold NumPy arrays, SciPy sparse matrices and
`chumpy` objects. All of these become inert records, of which `as_array` makes arrays later and
only where one is wanted: no constructor of NumPy's, SciPy's or Python's sees a file's values. Every
other global, so every malicious pickle, is refused before anything is called.

The unpickler is the standard library's in Python: the one in C reserves memory that an opcode asks
for, and crashes on keys that are nested deeply.
"""

from __future__ import annotations

import math
import pickle
import re
from collections.abc import Callable
from typing import IO, Any

import numpy as np
import scipy.sparse as sp

MOST_BYTES = 1 << 27
"""Of an array in a file of SMPL's: 300 shape components take 50 MB."""
_MOST_OPCODES = 200_000
"""SMPL's files have some thousands; each makes an object of up to 200 bytes."""
_NUMBERS = re.compile(r"[biuf][1248]|[SU]\d{1,4}")


class _Record:
    """An object that a pickle describes, kept as its bare state."""

    state: Any = None

    def __init__(self, *arguments: Any) -> None:
        self.arguments = arguments


class ChumpyRecord(_Record):
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


class CscRecord(_Record):
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


class _DtypeRecord(_Record):
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


class _ArrayRecord(_Record):
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

    def _parts(self) -> tuple[Any, _DtypeRecord, Any, Any]:
        if not isinstance(self.state, tuple) or len(self.state) != 5:
            raise pickle.UnpicklingError("an array without its values")
        _, shape, dtype, is_fortran, raw = self.state
        if not isinstance(dtype, _DtypeRecord):
            raise pickle.UnpicklingError("an array without a type")
        return shape, dtype, is_fortran, raw


class _ScalarRecord(_Record):
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
    if isinstance(value, (ChumpyRecord, CscRecord, _ArrayRecord, _ScalarRecord)):
        return value.to_array()
    if isinstance(value, (np.ndarray, float)):
        return np.asarray(value)
    raise pickle.UnpicklingError(f"a {type(value).__name__} in place of an array")


def load_restricted(file: IO[bytes]) -> Any:
    """Unpickle arrays, sparse matrices, chumpy objects and plain containers.

    Raises
    ------
    pickle.UnpicklingError
        If the pickle names anything else.
    """
    return _InertUnpickler(file).load()


def load_restricted_item(file: IO[bytes]) -> Any:
    """Unpickle the object in an `.npy` that holds one.

    Raises
    ------
    pickle.UnpicklingError
        If it is none, or `load_restricted` refuses it.
    """
    array = load_restricted(file)
    if not isinstance(array, _ArrayRecord):
        raise pickle.UnpicklingError("no array")
    return array.only_item()


def _fields(record: _Record) -> dict[str, Any]:
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


def _reconstructed_array(cls: Any, shape: Any, code: Any) -> _ArrayRecord:
    """NumPy's `_reconstruct`, whose other arguments the state replaces."""
    if cls is not _ArrayRecord:
        raise pickle.UnpicklingError("it asks to construct no array")
    return _ArrayRecord()


def _encoded(text: Any, encoding: Any = "latin1") -> Any:
    """Protocol 2's way to write bytes; they stay text, which holds one byte a character."""
    if encoding != "latin1":
        raise pickle.UnpicklingError("it asks for the codec of another text")
    return text


def _object(cls: Any, base: Any, state: Any) -> Any:
    """Python 2's constructor of objects, for the records only."""
    if cls not in (ChumpyRecord, CscRecord) or base is not _no_object or state is not None:
        raise pickle.UnpicklingError("it asks to construct something else")
    return cls()


def _no_object() -> None:
    """Stands for `object`, whose constructor is never wanted."""
    raise pickle.UnpicklingError("it asks to construct an object")


def _no_set(*_: Any) -> None:
    """Stands for `set`: chumpy's are of no use, and hashing what a file nests may never end."""


_GLOBALS: dict[tuple[str, str], Callable[..., Any]] = {
    ("numpy", "ndarray"): _ArrayRecord,
    ("numpy", "dtype"): _DtypeRecord,
    ("_codecs", "encode"): _encoded,
    **{
        (f"numpy.{core}.multiarray", name): constructor
        for core in ("core", "_core")
        for name, constructor in (("_reconstruct", _reconstructed_array), ("scalar", _ScalarRecord))
    },
    **{(module, "_reconstructor"): _object for module in ("copy_reg", "copyreg")},
    **{(module, "object"): _no_object for module in ("__builtin__", "builtins")},
    **{(module, "set"): _no_set for module in ("__builtin__", "builtins")},
}
_CALLABLE = (*_GLOBALS.values(), ChumpyRecord, CscRecord)

# In the standard library since Python 3.0, though without a public name.
_Unpickler: Any = pickle.__dict__["_Unpickler"]
# What the pickles of arrays, numbers, text and plain containers consist of.
_KNOWN = (
    "PROTO STOP FRAME MARK POP POP_MARK MEMOIZE PUT BINPUT LONG_BINPUT GET BINGET LONG_BINGET "
    "NONE NEWTRUE NEWFALSE INT BININT BININT1 BININT2 LONG LONG1 LONG4 FLOAT BINFLOAT "
    "STRING BINSTRING SHORT_BINSTRING UNICODE BINUNICODE SHORT_BINUNICODE BINUNICODE8 "
    "BINBYTES SHORT_BINBYTES BINBYTES8 EMPTY_TUPLE TUPLE TUPLE1 TUPLE2 TUPLE3 "
    "EMPTY_LIST LIST APPEND APPENDS EMPTY_DICT GLOBAL STACK_GLOBAL"
)


class _Opcodes(dict[int, Callable[..., Any]]):
    """What is done for each opcode, counting them."""

    count = 0

    def __getitem__(self, opcode: int) -> Callable[..., Any]:
        self.count += 1
        if self.count > _MOST_OPCODES:
            raise pickle.UnpicklingError(f"more than {_MOST_OPCODES} objects")
        return super().__getitem__(opcode)

    def __missing__(self, opcode: int) -> Callable[..., Any]:
        raise pickle.UnpicklingError(f"it asks for opcode {opcode}")


class _InertUnpickler(_Unpickler):
    def __init__(self, file: IO[bytes]) -> None:
        super().__init__(file, encoding="latin1")
        known = {opcode: _Unpickler.dispatch[opcode] for opcode in map(_opcode, _KNOWN.split())}
        self.dispatch = _Opcodes(known | _OWN)

    def find_class(self, module: str, name: str) -> Any:
        if module.split(".")[0] == "chumpy":
            return ChumpyRecord
        if module.startswith("scipy.sparse") and name == "csc_matrix":
            return CscRecord
        try:
            return _GLOBALS[module, name]
        except KeyError:
            raise pickle.UnpicklingError(f"it asks to run {module}.{name}") from None

    def load_call(self) -> None:
        """REDUCE and NEWOBJ: of what `find_class` gave, nothing else."""
        arguments, function = self.stack.pop(), self.stack[-1]
        if not any(function is known for known in _CALLABLE) or not isinstance(arguments, tuple):
            raise pickle.UnpicklingError("it asks to run something that it made")
        self.stack[-1] = function(*arguments)

    def load_state(self) -> None:
        """BUILD."""
        state, record = self.stack.pop(), self.stack[-1]
        if not isinstance(record, _Record):
            raise pickle.UnpicklingError(f"it asks to change a {type(record).__name__}")
        record.state = state

    def load_items(self) -> None:
        """SETITEMS."""
        items = self.pop_mark()
        self._set(self.stack[-1], items[::2], items[1::2])

    def load_one_item(self) -> None:
        """SETITEM."""
        value, key = self.stack.pop(), self.stack.pop()
        self._set(self.stack[-1], [key], [value])

    def load_dictionary(self) -> None:
        """DICT."""
        items = self.pop_mark()
        self.append({})
        self._set(self.stack[-1], items[::2], items[1::2])

    def load_no_set(self) -> None:
        """EMPTY_SET."""
        self.append(None)

    def load_no_items(self) -> None:
        """ADDITEMS."""
        self.pop_mark()

    def _set(self, target: Any, keys: list[Any], values: list[Any]) -> None:
        # Tuples that hold one another a million times over can be made, but not hashed.
        if not isinstance(target, dict) or not all(
            isinstance(key, (str, bytes, int)) for key in keys
        ):
            raise pickle.UnpicklingError("a dictionary with keys that are no names")
        target.update(zip(keys, values, strict=True))


def _opcode(name: str) -> int:
    return getattr(pickle, name)[0]


_OWN = {
    _opcode(name): function
    for name, function in {
        "REDUCE": _InertUnpickler.load_call,
        "NEWOBJ": _InertUnpickler.load_call,
        "BUILD": _InertUnpickler.load_state,
        "SETITEM": _InertUnpickler.load_one_item,
        "SETITEMS": _InertUnpickler.load_items,
        "DICT": _InertUnpickler.load_dictionary,
        "EMPTY_SET": _InertUnpickler.load_no_set,
        "ADDITEMS": _InertUnpickler.load_no_items,
    }.items()
}
