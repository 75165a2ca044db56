"""Read SMPL's pickles without running anything that they contain.

The licensed files were pickled by Python 2 and hold NumPy arrays, SciPy sparse matrices and
`chumpy` objects. Arrays are rebuilt by NumPy; matrices and chumpy objects become inert records,
evaluated later. Every other global, so every malicious pickle, is refused before anything is
called.
"""

from __future__ import annotations

import pickle
from typing import IO, Any

import numpy as np
import scipy.sparse as sp


class _Record:
    """An object that a pickle describes, kept as its bare state."""

    def __init__(self, *_: Any) -> None:
        self.state: dict[str, Any] = {}

    def __setstate__(self, state: Any) -> None:
        if not isinstance(state, dict):
            raise pickle.UnpicklingError(f"an object state of type {type(state).__name__}")
        self.state = state


class ChumpyRecord(_Record):
    """State of a chumpy object; `to_array` evaluates the two kinds that SMPL files use."""

    def to_array(self) -> np.ndarray:
        """Value of a `chumpy.Ch` (its `x`) or a `chumpy.reordering.Select` (`a` at `idxs`).

        Raises
        ------
        pickle.UnpicklingError
            If the record is of another kind.
        """
        if "idxs" in self.state and "a" in self.state:
            selected = as_array(self.state["a"]).ravel()[np.asarray(self.state["idxs"])]
            shape = self.state.get("preferred_shape")
            return selected if shape is None else selected.reshape(shape)
        if "x" in self.state:
            return as_array(self.state["x"])
        raise pickle.UnpicklingError(f"a chumpy object with only {sorted(self.state)}")


class CscRecord(_Record):
    """State of a `scipy.sparse.csc_matrix`, of whatever SciPy version."""

    def to_csr(self) -> sp.csr_matrix:
        """The matrix; its indices are checked, because SciPy's routines trust them."""
        shape = self.state.get("_shape", self.state.get("shape"))
        matrix = sp.csc_matrix(
            (self.state["data"], self.state["indices"], self.state["indptr"]), shape=shape
        )
        matrix.check_format(full_check=True)
        return sp.csr_matrix(matrix)


def as_array(value: Any) -> np.ndarray:
    """A dense array from what a pickle's field held: an array or one of the records."""
    if isinstance(value, ChumpyRecord):
        return value.to_array()
    if isinstance(value, CscRecord):
        return value.to_csr().toarray()
    return np.asarray(value)


def load_restricted(file: IO[bytes]) -> Any:
    """Unpickle arrays, sparse matrices, chumpy records and plain containers.

    Raises
    ------
    pickle.UnpicklingError
        If the pickle names anything else.
    """
    return _RestrictedUnpickler(file, encoding="latin1").load()


class _RestrictedUnpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        if module.split(".")[0] == "chumpy":
            return ChumpyRecord
        if module.startswith("scipy.sparse") and name == "csc_matrix":
            return CscRecord
        try:
            return _ALLOWED[module, name]
        except KeyError:
            raise pickle.UnpicklingError(f"it asks to run {module}.{name}") from None


def _encode_latin1(text: str, encoding: str = "latin1") -> bytes:
    """Protocol 2's way to write bytes; the real `_codecs.encode` reaches every codec."""
    if encoding != "latin1":
        raise pickle.UnpicklingError(f"it asks for the codec {encoding}")
    return text.encode("latin1")


def _reconstruct_object(cls: type, base: type, state: Any) -> Any:
    """Python 2's constructor of objects, for the records only."""
    if cls not in (ChumpyRecord, CscRecord) or base is not object or state is not None:
        raise pickle.UnpicklingError(f"it asks to construct {cls!r}")
    return cls()


# NumPy's own constructors, taken from its pickles, because their module has moved over time.
_NUMPY_CONSTRUCTORS = {
    "_reconstruct": np.zeros(0).__reduce__()[0],
    "scalar": np.float64(0).__reduce__()[0],
}
_ALLOWED: dict[tuple[str, str], Any] = {
    ("numpy", "ndarray"): np.ndarray,
    ("numpy", "dtype"): np.dtype,
    ("_codecs", "encode"): _encode_latin1,
    **{
        (f"numpy.{core}.multiarray", name): constructor
        for core in ("core", "_core")
        for name, constructor in _NUMPY_CONSTRUCTORS.items()
    },
    **{(module, "_reconstructor"): _reconstruct_object for module in ("copy_reg", "copyreg")},
    **{(module, "object"): object for module in ("__builtin__", "builtins")},
    **{(module, "set"): set for module in ("__builtin__", "builtins")},
}
