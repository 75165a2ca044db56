"""Pickles as joblib and PyTorch write them, by their formats."""

from __future__ import annotations

import contextlib
import io
import pickle
import sys
import types
import zipfile
from collections import OrderedDict
from collections.abc import Iterator
from typing import Any

import numpy as np


def by_joblib(found: Any) -> bytes:
    """As joblib pickles: each array a small object, after which its numbers stand in the file."""
    wrapped = _stand_in("joblib.numpy_pickle", "NumpyArrayWrapper")

    class Pickler(pickle._Pickler):  # type: ignore[attr-defined]
        def save(self, obj: Any, save_persistent_id: bool = True) -> None:
            save: Any = super().save  # type: ignore[misc]
            if not isinstance(obj, np.ndarray):
                save(obj, save_persistent_id)
                return
            wrapper = wrapped()
            wrapper.__dict__ |= {
                "subclass": np.ndarray, "shape": obj.shape, "order": "C", "dtype": obj.dtype,
                "allow_mmap": True, "numpy_array_alignment_bytes": 16,
            }  # fmt: skip
            save(wrapper, save_persistent_id)
            self.framer.commit_frame(force=True)  # type: ignore[attr-defined]
            self.framer.file_write(b"\3" + b"\xff" * 3 + obj.tobytes())  # type: ignore[attr-defined]

    stream = io.BytesIO()
    with _modules(wrapped):
        Pickler(stream, protocol=4).dump(found)
    return stream.getvalue()


def by_torch(found: Any) -> bytes:
    """As `torch.save` writes arrays: a pickle of tensors, their numbers in files beside it."""
    rebuild = _stand_in("torch._utils", "_rebuild_tensor_v2")
    storages = {kind: _stand_in("torch", f"{name}Storage")
                for kind, name in {"f": "Double", "b": "Bool"}.items()}  # fmt: skip
    numbers: list[bytes] = []

    class Pickler(pickle._Pickler):  # type: ignore[attr-defined]
        def reducer_override(self, obj: Any) -> Any:
            if not isinstance(obj, np.ndarray):
                return NotImplemented
            kind = "b" if obj.dtype == bool else "f"
            numbers.append(obj.astype("<f8" if kind == "f" else bool).tobytes())
            steps = np.cumprod([1, *obj.shape[:0:-1]])[::-1].tolist()
            kept = types.SimpleNamespace(key=str(len(numbers) - 1), size=obj.size, kind=kind)
            return rebuild, (kept, 0, obj.shape, tuple(steps), False, OrderedDict())

        def persistent_id(self, obj: Any) -> Any:
            if isinstance(obj, types.SimpleNamespace):
                return "storage", storages[obj.kind], obj.key, "cpu", obj.size
            return None

    stream, whole = io.BytesIO(), io.BytesIO()
    with _modules(rebuild, *storages.values()):
        Pickler(stream, protocol=2).dump(found)
    with zipfile.ZipFile(whole, "w") as archive:
        archive.writestr("results/data.pkl", stream.getvalue())
        for key, data in enumerate(numbers):
            archive.writestr(f"results/data/{key}", data)
    return whole.getvalue()


def _stand_in(module: str, name: str) -> type:
    """A class that is pickled by another's name."""
    return type(name, (), {"__module__": module, "__qualname__": name})


@contextlib.contextmanager
def _modules(*stand_ins: type) -> Iterator[None]:
    """Modules in which stand-ins are found."""
    names = {name for one in stand_ins for name in (one.__module__, one.__module__.split(".")[0])}
    known = {name: sys.modules.get(name) for name in names}
    for name in names:
        sys.modules[name] = types.ModuleType(name)
    for one in stand_ins:
        setattr(sys.modules[one.__module__], one.__name__, one)
    try:
        yield
    finally:
        for name, before in known.items():
            sys.modules.pop(name)
            if before is not None:
                sys.modules[name] = before
