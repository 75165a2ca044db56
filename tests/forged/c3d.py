"""C3D files, byte by byte: of real numbers or whole ones, of three kinds of processors."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_BLOCK = 512


def c3d(
    points: NDArray,
    labels: Sequence[str],
    *,
    fps: float = 60.0,
    units: str = "mm",
    processor: int = 84,
    scale: float = -1.0,
    analog: int = 0,
    angles: Sequence[str] = (),
) -> bytes:
    """A file of points (T, N, 3); NaN is what was not seen. Scale > 0: whole numbers."""
    order = ">" if processor == 86 else "<"
    frames, count = points.shape[:2]
    parameters = b"".join(
        [
            struct.pack("bb", 5, -1) + b"POINT" + struct.pack(f"{order}hB", 3, 0),
            _texts(order, "LABELS", labels),
            _texts(order, "ANGLES", angles) if angles else b"",
            _texts(order, "UNITS", [units]),
            *(
                _parameter(order, name, 2, (), struct.pack(f"{order}H", number))
                for name, number in (("USED", count), ("FRAMES", frames), ("DATA_START", 3))
            ),
            _parameter(order, "RATE", 4, (), _floats([fps], processor)),
            _parameter(order, "SCALE", 4, (), _floats([scale], processor)),
            b"\0",
        ]
    )
    blocks = -(-(len(parameters) + 4) // _BLOCK)
    parameters = bytes((1, 80, blocks, processor)) + parameters
    header = bytes((2, 80)) + struct.pack(f"{order}5H", count, analog, 1, min(frames, 65535), 10)
    header += _floats([scale], processor) + struct.pack(f"{order}2H", 2 + blocks, 1)
    header += _floats([fps], processor)
    rows = np.zeros((frames, 4 * count + analog))
    quads = np.concatenate([points, np.zeros((frames, count, 1))], axis=2)
    quads[np.isnan(points).any(axis=2)] = (0, 0, 0, -1)
    rows[:, : 4 * count] = quads.reshape(frames, -1)
    if scale < 0:
        data = _floats(rows, processor)
    else:
        rows.reshape(frames, -1, 4)[..., :3] /= scale
        data = np.round(rows).astype(f"{order}i2").tobytes()
    return header.ljust(_BLOCK, b"\0") + parameters.ljust(blocks * _BLOCK, b"\0") + data


def _floats(values: object, processor: int) -> bytes:
    numbers = np.asarray(values, np.float32)
    if processor == 85:
        return (numbers * 4).view("<u2").reshape(-1, 2)[:, ::-1].tobytes()
    return numbers.astype(">f4" if processor == 86 else "<f4").tobytes()


def _texts(order: str, name: str, texts: Sequence[str]) -> bytes:
    width = max(map(len, texts))
    data = "".join(text.ljust(width) for text in texts).encode("latin1")
    return _parameter(order, name, -1, (width, len(texts)), data)


def _parameter(order: str, name: str, kind: int, sizes: tuple[int, ...], data: bytes) -> bytes:
    rest = struct.pack("bB", kind, len(sizes)) + bytes(sizes) + data + b"\0"
    head = struct.pack("bb", len(name), 1) + name.encode()
    return head + struct.pack(f"{order}h", len(rest) + 2) + rest
