"""Read what `torch.save` wrote, without PyTorch; nothing in it is executed."""

from __future__ import annotations

import math
import zipfile
from typing import IO, Any

import numpy as np

from bridge.body.pickled_arrays import Record, whole_numbers
from bridge.body.safe_pickle import STORAGES, Global, load_restricted

MOST_TENSOR_BYTES = 1 << 29
_MOST_ITEMS = 10_000


def load_torch(file: IO[bytes]) -> Any:
    """What `torch.save` wrote, with arrays in place of tensors."""
    with zipfile.ZipFile(file) as archive:
        (inside,) = (name for name in archive.namelist() if name.endswith("data.pkl"))
        if archive.getinfo(inside).file_size > MOST_TENSOR_BYTES:
            raise ValueError("a pickle beyond all measure")
        with archive.open(inside) as stream:
            found = load_restricted(stream, of_torch=True)
        return _filled(found, archive, inside.removesuffix("data.pkl"), depth=4)


def _filled(value: Any, archive: zipfile.ZipFile, folder: str, depth: int) -> Any:
    if isinstance(value, dict) and depth:
        return {n: _filled(v, archive, folder, depth - 1) for n, v in value.items()}
    if isinstance(value, list) and depth:
        return [_filled(v, archive, folder, depth - 1) for v in value[:_MOST_ITEMS]]
    if (parts := _parts_of(value)) is None:
        return value
    name, dtype, begin, shape, strides = parts
    info = archive.getinfo(f"{folder}data/{name}")
    if info.file_size > MOST_TENSOR_BYTES or info.compress_type != zipfile.ZIP_STORED:
        raise ValueError(f"a tensor of {info.file_size} bytes")
    if len(strides) != len(shape) or math.prod(shape) * dtype.itemsize > MOST_TENSOR_BYTES:
        raise ValueError(f"a tensor of shape {shape}")
    numbers = np.frombuffer(archive.read(info), dtype)
    last = begin + sum((size - 1) * step for size, step in zip(shape, strides, strict=True))
    if begin < 0 or (math.prod(shape) and last >= len(numbers)):
        raise ValueError("a tensor beyond its numbers")
    if not math.prod(shape):
        return np.empty(shape, dtype)
    steps = tuple(step * dtype.itemsize for step in strides)
    return np.lib.stride_tricks.as_strided(numbers[begin:], shape, steps, writeable=False).copy()


def _parts_of(value: Any) -> tuple[str, np.dtype, int, tuple[int, ...], tuple[int, ...]] | None:
    """Of a tensor in a torch file: the name of its numbers, their type, where it begins, its shape
    and strides; None of anything else."""
    match value:
        case Record("tensor", (Record("storage", (stored,)), int(at), shape, strides, *_)):
            _, kind, name, *_ = stored
            if isinstance(kind, Global) and kind.kind in STORAGES.values():
                sizes = whole_numbers(shape), whole_numbers(strides)
                return str(name), np.dtype(f"<{kind.kind}"), at, *sizes
    return None
