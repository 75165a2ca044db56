"""C3D: labelled points with their units and rate, but without an axis that is up.

It is read here, in NumPy, because the sizes that it declares are to be checked before anything is
allocated: of `ezc3d`, which is fine for files of one's own, one damaged file in fourteen took the
process down.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.motion.markers import StoredMarkers, refused
from bridge.motion.motion import MOST_FRAMES, RATES_HZ
from bridge.runs.untrusted import open_regular

_BLOCK = 512
_MOST_BYTES, _MOST_PARAMETER_BYTES = 1 << 30, 256 * _BLOCK
_PER_M = {"mm": 1e3, "cm": 1e2, "m": 1.0}
_NUMBERS = {84: "<", 85: "<", 86: ">"}
"""Order of bytes by processor; of the second, DEC, floats have their halves exchanged too."""
_DEC = 85
_NO_PLACES = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS")
"""Lists of points whose numbers are no places."""


def read_c3d(path: Path) -> StoredMarkers:
    """Labelled points; those that are angles or forces are left out."""
    with open_regular(path, _MOST_BYTES) as file:
        raw = file.read()
    if len(raw) < 2 * _BLOCK or raw[1] != 0x50:
        raise ValueError("no C3D")
    begins = (raw[0] - 1) * _BLOCK
    if begins < _BLOCK or len(raw) < begins + 4 or raw[begins + 3] not in _NUMBERS:
        raise ValueError("a C3D of an unknown processor")
    file = _C3d(raw, begins, raw[begins + 3])
    labels = file.texts("LABELS")
    for number in range(2, 10):
        labels += file.texts(f"LABELS{number}")
    labels = [*labels, *[""] * file.count][: file.count]
    if not file.count:
        raise refused(path, "a C3D without points", "labelled markers")
    points = file.points()
    others = {name for key in _NO_PLACES for name in file.texts(key)}
    kept = [n for n, label in enumerate(labels) if label.strip("* ") and label not in others]
    if not kept:
        raise refused(path, "a C3D of points without names", "names such as C7, CLAV, LBUST")
    per_m = _PER_M.get(next(iter(file.texts("UNITS")), "").lower())
    return StoredMarkers(points[:, kept], [labels[n] for n in kept], file.fps, per_m, upright=False)


class _C3d:
    """Header, parameters of the group POINT, and data of a file in memory."""

    def __init__(self, raw: bytes, begins: int, processor: int) -> None:
        self._raw, self._order, self._dec = raw, _NUMBERS[processor], processor == _DEC
        self._point = dict(self._parameters(begins))
        words = np.frombuffer(raw, f"{self._order}u2", 10)
        self._first, self._last = int(words[3]), int(words[4])
        self.count, self._analog = int(words[1]), int(words[2])
        self._data = (int(words[8]) - 1) * _BLOCK
        scale, rate = (self._floats(raw[start : start + 4])[0] for start in (12, 20))
        self._scale = float(self.numbers("SCALE", scale)[0])
        self.fps = float(self.numbers("RATE", rate)[0])
        if not (RATES_HZ[0] <= self.fps <= RATES_HZ[1] and math.isfinite(self._scale)):
            raise ValueError(f"a C3D at {self.fps:g} frames a second, scaled by {self._scale:g}")

    def numbers(self, name: str, otherwise: float) -> NDArray:
        """A parameter's, or another number where it has none."""
        kind, _, raw = self._point.get(name, (0, (), b""))
        numbers = self._floats(raw) if kind == 4 else np.frombuffer(raw, f"{self._order}u2")
        return numbers if kind in (2, 4) and len(numbers) else np.array([otherwise])

    def texts(self, name: str) -> list[str]:
        """A parameter's, none where it has none."""
        kind, sizes, raw = self._point.get(name, (0, (), b""))
        width = sizes[0] if kind == -1 and sizes else 0
        rows = (raw[start : start + width] for start in range(0, len(raw), max(width, 1)))
        return [row.decode("latin1").strip(" \0") for row in rows] if width else []

    def points(self) -> NDArray[np.float64]:
        """(T, N, 3), NaN where they were not seen."""
        real = self._scale < 0
        width = 4 * self.count + self._analog
        frame_bytes = width * (4 if real else 2)
        there = max(0, len(self._raw) - self._data) // frame_bytes
        stated = self._last - self._first + 1
        # What is longer than 65,535 frames says so in other places, each writer in its own way.
        frames = there if self._last == 0xFFFF else stated
        if not 0 < frames <= min(there, MOST_FRAMES):
            raise ValueError(f"a C3D of {stated} frames with the data of {there}")
        data = self._raw[self._data : self._data + frames * frame_bytes]
        values = self._floats(data) if real else np.frombuffer(data, f"{self._order}i2")
        rows = values.reshape(frames, width)[:, : 4 * self.count].reshape(frames, -1, 4)
        points = rows[..., :3].astype(np.float64) * (1.0 if real else self._scale)
        points[rows[..., 3] < 0] = np.nan
        return points

    def _floats(self, raw: bytes) -> NDArray[np.float64]:
        raw, per_one = raw[: len(raw) // 4 * 4], 1
        floats = np.frombuffer(raw, f"{self._order}f4")
        if self._dec:  # halves the other way round, and four times as large
            floats = np.ascontiguousarray(floats.view("<u2").reshape(-1, 2)[:, ::-1]).view("<f4")
            per_one = 4
        with np.errstate(invalid="ignore"):  # of some numbers that are none
            return floats.ravel().astype(np.float64) / per_one

    def _parameters(self, begins: int) -> Iterator[tuple[str, tuple[int, tuple[int, ...], bytes]]]:
        """Name, type, sizes and bytes of those of the group POINT."""
        values: list[tuple[int, str, tuple[int, tuple[int, ...], bytes]]] = []
        groups: dict[int, str] = {}
        at, raw = begins + 4, self._raw[: begins + _MOST_PARAMETER_BYTES]
        while at + 4 <= len(raw) and (length := abs(struct.unpack_from("b", raw, at)[0])):
            group = struct.unpack_from("b", raw, at + 1)[0]
            name = raw[at + 2 : at + 2 + length].decode("latin1").upper()
            at += 2 + length
            (further,) = struct.unpack_from(f"{self._order}h", raw, at)
            if group < 0:
                groups[-group] = name
            else:
                kind, rank = struct.unpack_from("bB", raw, at + 2)
                sizes = tuple(raw[at + 4 : at + 4 + rank])
                start = at + 4 + rank
                data = raw[start : start + abs(kind) * math.prod(sizes)]
                values.append((group, name, (kind, sizes, data)))
            if further <= 0:
                break
            at += further
        yield from ((name, value) for group, name, value in values if groups.get(group) == "POINT")
