"""Pickles as Python 2 wrote SMPL's: raw strings, chumpy objects, the module names of those days.

Nothing of chumpy, an old SciPy or Python 2 is needed: the globals' names are written directly.
"""

from __future__ import annotations

import io
import pickle
import struct
from typing import Any

import numpy as np
import scipy.sparse as sp

# The pickler in Python, unlike the one in C, lets a subclass choose opcodes.
_Pickler: Any = pickle.__dict__["_Pickler"]


class Ch:
    """Stands for `chumpy.ch.Ch`: a constant."""

    def __init__(self, x: Any) -> None:
        self.__dict__.update(_chumpy_state(), x=x)


class Select:
    """Stands for `chumpy.reordering.Select`: what slicing a chumpy array gives."""

    def __init__(self, a: Any, idxs: np.ndarray, preferred_shape: tuple[int, ...]) -> None:
        self.__dict__.update(_chumpy_state(), a=a, idxs=idxs, preferred_shape=preferred_shape)


def _chumpy_state() -> dict[str, Any]:
    return {
        "_dirty_vars": {"x"},
        "_itr": None,
        "_make_dense": False,
        "_make_sparse": False,
        "_depends_on_deps": {},
    }


def sliced(a: Any, shape: tuple[int, ...], count: int) -> Select:
    """What chumpy makes of `a[..., :count]` of an array of `shape`."""
    kept = np.arange(np.prod(shape)).reshape(shape)[..., :count]
    return Select(a, kept.ravel(), kept.shape)


class Python2Pickler(_Pickler):
    """Writes what `cPickle.dump(..., protocol)` of Python 2 wrote, for protocols 0 to 2."""

    dispatch = _Pickler.dispatch.copy()

    def __init__(self, file: Any, protocol: int, scipy_module: str) -> None:
        super().__init__(file, protocol)
        self._names: dict[Any, str] = {
            Ch: "chumpy.ch Ch",
            Select: "chumpy.reordering Select",
            sp.csc_matrix: f"{scipy_module} csc_matrix",
            sp.coo_matrix: f"{scipy_module.replace('csc', 'coo')} coo_matrix",
            np.zeros(0).__reduce__()[0]: "numpy.core.multiarray _reconstruct",
            np.float64(0).__reduce__()[0]: "numpy.core.multiarray scalar",
        }

    def save_global(self, obj: Any, name: str | None = None) -> None:
        try:
            known = self._names.get(obj)
        except TypeError:  # what cannot be hashed is none of them
            known = None
        if known is None:
            super().save_global(obj, name)
        else:
            self.write(pickle.GLOBAL + known.replace(" ", "\n").encode() + b"\n")
            self.memoize(obj)

    def save_string(self, text: str | bytes) -> None:
        raw = text.encode("latin1") if isinstance(text, str) else text
        if self.proto == 0:
            quoted = repr(raw)[1:].encode("ascii")
            self.write(pickle.STRING + quoted + b"\n")
        elif len(raw) < 256:
            self.write(pickle.SHORT_BINSTRING + bytes([len(raw)]) + raw)
        else:
            self.write(pickle.BINSTRING + struct.pack("<i", len(raw)) + raw)
        self.memoize(text)

    dispatch[bytes] = dispatch[str] = save_string
    # Classes and functions are looked up by type, so their entries must name the override.
    dispatch[type(len)] = dispatch[type(np.dot)] = save_global


def python2_pickle(
    content: Any, protocol: int = 2, scipy_module: str = "scipy.sparse.csc"
) -> bytes:
    """The bytes of `content`'s pickle."""
    file = io.BytesIO()
    Python2Pickler(file, protocol, scipy_module).dump(content)
    return file.getvalue()
