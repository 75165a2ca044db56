"""Read SMPL's pickles without running anything that they contain.

The licensed files were pickled by Python 2 and hold NumPy arrays, SciPy sparse matrices and
`chumpy` objects. All of these become inert records (`bridge.body.pickle_records`), of which
`as_array` makes arrays later and only where one is wanted. Every other global, so every malicious
pickle, is refused before anything is called.

The unpickler is the standard library's in Python: the one in C reserves memory that an opcode asks
for, and crashes on keys that are nested deeply.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import IO, Any

from bridge.body.pickle_records import (
    ArrayRecord,
    ChumpyRecord,
    CscRecord,
    DtypeRecord,
    Record,
    ScalarRecord,
)

_MOST_OPCODES = 200_000
"""SMPL's files have some thousands; each makes an object of up to 200 bytes."""


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
    if not isinstance(array, ArrayRecord):
        raise pickle.UnpicklingError("no array")
    return array.only_item()


def _reconstructed_array(cls: Any, shape: Any, code: Any) -> ArrayRecord:
    """NumPy's `_reconstruct`, whose other arguments the state replaces."""
    if cls is not ArrayRecord:
        raise pickle.UnpicklingError("it asks to construct no array")
    return ArrayRecord()


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
    ("numpy", "ndarray"): ArrayRecord,
    ("numpy", "dtype"): DtypeRecord,
    ("_codecs", "encode"): _encoded,
    **{
        (f"numpy.{core}.multiarray", name): constructor
        for core in ("core", "_core")
        for name, constructor in (("_reconstruct", _reconstructed_array), ("scalar", ScalarRecord))
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
        if not isinstance(record, Record):
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
