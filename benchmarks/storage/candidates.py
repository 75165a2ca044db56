"""Ways to store consecutive frames of vertices, lossless or not."""

from __future__ import annotations

import io
import pickle
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from benchmarks.storage.subspace import Subspace
from bridge.exchange.packed.codec import CodedFrames, decode, encode, step_for

Frames = NDArray[np.float32]
_DEFLATE_LEVEL = 6
_ZSTD_LEVEL = 3


@dataclass(frozen=True)
class Encoding:
    """One way; `decode(encode(frames), shape)` gives the frames (n, V, 3) again."""

    label: str
    encode: Callable[[Frames], bytes]
    decode: Callable[[bytes, tuple[int, int, int]], Frames]
    bound_mm: float | None = None
    """What it promises of every coordinate; 0 of lossless ones, None where it promises nothing."""
    shared_bytes: int = 0
    """What is stored once for all frames."""


def candidates(subspaces: dict[int, Subspace]) -> list[Encoding]:
    """All of them; those of zstd where its library is installed.

    Parameters
    ----------
    subspaces : by their number of directions.
    """
    found = [
        Encoding("float32", _raw, lambda data, shape: _array(data, "<f4", shape), 0.0),
        _exact("deflate", _deflated, zlib.decompress),
        _hdf5("HDF5: shuffle, gzip 4", 0.0),
        Encoding("float16", lambda x: x.astype("<f2").tobytes(), _from_half),
        # Half of a digit off, as a rule, but some numbers are a whole one off: no bound is stated.
        _hdf5("HDF5: scale-offset 5 digits, shuffle, gzip 4", None, scaleoffset=5),
        _stepped("whole steps", 0.01, (0,)),
        *(_stepped("`dsnet pack`", bound_mm, (1, 2)) for bound_mm in (0.1, 0.01, 0.001)),
    ]
    if find_spec("zstandard"):
        import zstandard

        pack = zstandard.ZstdCompressor(_ZSTD_LEVEL).compress
        unpack = zstandard.ZstdDecompressor().decompress
        found.insert(2, _exact(f"zstd {_ZSTD_LEVEL}", pack, unpack))
        found.append(_stepped("the same, zstd 3", 0.01, (1, 2), pack, unpack))
    for subspace in subspaces.values():
        count = len(subspace.directions)  # fewer where frames have no more
        found.append(_projected(f"{count} directions alone", subspace))
        found.append(_with_rest(f"{count} directions, the rest packed", subspace, 0.01))
    return found


def _raw(frames: Frames) -> bytes:
    return frames.astype("<f4").tobytes()


def _array(data: bytes, dtype: str, shape: tuple[int, int, int]) -> Frames:
    return np.frombuffer(data, dtype).reshape(shape).astype(np.float32)


def _from_half(data: bytes, shape: tuple[int, int, int]) -> Frames:
    return _array(data, "<f2", shape)


def _deflated(data: bytes) -> bytes:
    return zlib.compress(data, _DEFLATE_LEVEL)


def _exact(name: str, pack: Callable[[bytes], bytes], unpack: Callable[[bytes], bytes]) -> Encoding:
    """The four bytes of each number apart, then compressed."""

    def encoded(frames: Frames) -> bytes:
        return pack(np.ascontiguousarray(frames.reshape(-1, 1).view(np.uint8).T).tobytes())

    def decoded(data: bytes, shape: tuple[int, int, int]) -> Frames:
        planes = np.frombuffer(unpack(data), np.uint8).reshape(4, -1)
        return np.ascontiguousarray(planes.T).view(np.float32).reshape(shape)

    return Encoding(f"float32: shuffle, {name}", encoded, decoded, 0.0)


def _hdf5(label: str, bound_mm: float | None, **filters: Any) -> Encoding:
    def encoded(frames: Frames) -> bytes:
        buffer = io.BytesIO()
        with h5py.File(buffer, "w") as file:
            file.create_dataset("x", data=frames, chunks=(min(16, len(frames)), *frames.shape[1:]),
                                compression=4, shuffle=True, **filters)  # fmt: skip
        return buffer.getvalue()

    def decoded(data: bytes, shape: tuple[int, int, int]) -> Frames:
        with h5py.File(io.BytesIO(data), "r") as file:
            dataset = file["x"]
            assert isinstance(dataset, h5py.Dataset)
            return dataset[:].reshape(shape)

    return Encoding(label, encoded, decoded, bound_mm)


def _stepped(
    name: str,
    bound_mm: float,
    differences: tuple[int, ...],
    pack: Callable[[bytes], bytes] = _deflated,
    unpack: Callable[[bytes], bytes] = zlib.decompress,
) -> Encoding:
    """The codec of packed files, with or without its differences in time."""

    def encoded(frames: Frames) -> bytes:
        step = step_for(1e-3 * bound_mm, float(np.abs(frames).max()))
        coded = encode(frames, step, differences)
        return pickle.dumps((pack(coded.planes.tobytes()), coded.differences, step))

    def decoded(data: bytes, shape: tuple[int, int, int]) -> Frames:
        packed, times, step = pickle.loads(data)
        planes = np.frombuffer(unpack(packed), np.uint8).reshape(-1, int(np.prod(shape)))
        return decode(CodedFrames(planes, times), step, shape)

    return Encoding(name, encoded, decoded, bound_mm)


def _projected(label: str, subspace: Subspace) -> Encoding:
    def decoded(data: bytes, shape: tuple[int, int, int]) -> Frames:
        coefficients = np.frombuffer(data, np.float32).reshape(shape[0], -1)
        return subspace.frames(coefficients, shape).astype(np.float32)

    return Encoding(
        label,
        lambda frames: subspace.coefficients(frames).tobytes(),
        decoded,
        shared_bytes=subspace.size_bytes,
    )


def _with_rest(label: str, subspace: Subspace, bound_mm: float) -> Encoding:
    """A subspace, and what it leaves in whole steps: within the bound at every coordinate."""
    # Half of a last bit of the sum, for meshes of some metres.
    rest = _stepped("", bound_mm - 1e-3, (1, 2))

    def encoded(frames: Frames) -> bytes:
        coefficients = subspace.coefficients(frames)
        left = frames - subspace.frames(coefficients, frames.shape)
        return pickle.dumps((coefficients.tobytes(), rest.encode(left)))

    def decoded(data: bytes, shape: tuple[int, int, int]) -> Frames:
        coefficients, left = pickle.loads(data)
        within = np.frombuffer(coefficients, np.float32).reshape(shape[0], -1)
        return (subspace.frames(within, shape) + rest.decode(left, shape)).astype(np.float32)

    return Encoding(label, encoded, decoded, bound_mm, subspace.size_bytes)
