"""Read what `torch.save` and safetensors wrote, without PyTorch; nothing in it is executed."""

from __future__ import annotations

import json
import math
import zipfile
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from bridge.body.safe_pickle import STORAGES, Global, Record, load_restricted, whole_numbers

MOST_TENSOR_BYTES = 1 << 29
_MOST_ITEMS = 10_000
_MOST_HEADER_BYTES = 1 << 20
_TYPES = {"F64": "<f8", "F32": "<f4", "F16": "<f2", "I64": "<i8", "I32": "<i4", "U32": "<u4"}


def load_torch(file: IO[bytes]) -> Any:
    """What `torch.save` wrote, with arrays in place of tensors."""
    with zipfile.ZipFile(file) as archive:
        (inside,) = (name for name in archive.namelist() if name.endswith("data.pkl"))
        if archive.getinfo(inside).file_size > MOST_TENSOR_BYTES:
            raise ValueError("a pickle beyond all measure")
        with archive.open(inside) as stream:
            found = load_restricted(stream, of_torch=True)
        return _filled(found, archive, inside.removesuffix("data.pkl"), depth=4)


def load_safetensors(file: IO[bytes]) -> dict[str, NDArray]:
    """The tensors of a `.safetensors` whose types NumPy has."""
    length = int.from_bytes(file.read(8), "little")
    if length > _MOST_HEADER_BYTES:
        raise ValueError(f"a header of {length} bytes")
    header, data = json.loads(file.read(length)), file.read()
    found = {}
    for name, entry in header.items():
        if name == "__metadata__" or (dtype := _TYPES.get(entry["dtype"])) is None:
            continue
        begin, end = entry["data_offsets"]
        shape = whole_numbers(entry["shape"])
        found[name] = np.frombuffer(data[begin:end], dtype, math.prod(shape)).reshape(shape)
    return found


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
        case Record(
            "tensor",
            (
                Record("storage", ((_, Global(code), str(name), _, _),)),
                int(at),
                shape,
                strides,
                *_,
            ),
        ) if code in STORAGES.values():
            return name, np.dtype(f"<{code}"), at, whole_numbers(shape), whole_numbers(strides)
    return None
