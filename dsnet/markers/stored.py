"""Markers as a file has them, and the refusal of one.

An AMASS `.npz` of the SMPL-H release calls them `marker_data` and `marker_labels`, one that MoSh++
exports `markers` and `labels`; `*_stageii.pkl` is MoSh++'s own. C3D has labelled points alone, with
its units and rate, but not which axis is up. It is read here, in NumPy, because the sizes that it
declares are to be checked before anything is allocated: of `ezc3d`, which is fine for files of
one's own, one damaged file in fourteen took the process down.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body.pickled_arrays import as_array
from bridge.body.safe_pickle import load_restricted_item
from bridge.errors import DsnetError
from bridge.motion.motion import MOST_FRAMES, RATES_HZ
from bridge.motion.readers.pickles import opened, within
from bridge.runs.untrusted import UntrustedNpz, open_npz, open_regular

_MOST_MARKERS = 500
_KEYS = (("marker_data", "marker_labels"), ("markers", "labels"))
_VERTICES = "markers_latent_vids"
_SMPLX_POSE = (165,)
_BLOCK = 512
_MOST_BYTES, _MOST_PARAMETER_BYTES = 1 << 30, 256 * _BLOCK
_PER_M = {"mm": 1e3, "cm": 1e2, "m": 1.0}
_NUMBERS = {84: "<", 85: "<", 86: ">"}
"""Order of bytes by processor; of the second, DEC, floats have their halves exchanged too."""
_DEC = 85
_NO_PLACES = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS")
"""Lists of points whose numbers are no places."""


@dataclass(frozen=True, eq=False)
class Stored:
    """Markers as their file has them."""

    points: NDArray
    """(T, N, 3) numbers, zero or NaN where a marker was not seen."""
    labels: list[str]
    fps: float | None = None
    """None: a row for each frame of the pose."""
    per_m: float | None = None
    """Units in a metre; None where the file does not say."""
    upright: bool = True
    """Whether they are z up, as the pose that was fitted to them; else nobody knows."""
    vertices: Mapping[str, int] = field(default_factory=dict)
    """Of SMPL, by label, where the file says them."""


def refused(
    path: Path, received: str, expected: str, remedy: str = "Pass a file with skin markers"
) -> DsnetError:
    """The refusal of a file."""
    return DsnetError(f"{path}, {received}", expected, f"{remedy}.")


def npz_has_markers(path: Path) -> bool:
    """By the names of its arrays."""
    with open_npz(path) as archive:
        return _keys(archive) is not None


def read_npz(path: Path) -> Stored:
    """Both arrays, and the vertex of each marker where the file has it."""
    with open_npz(path) as archive:
        if (keys := _keys(archive)) is None:
            raise refused(
                path,
                "a file without 'marker_data' and 'marker_labels'",
                "markers (T, N, 3) and their names (N,), or a .c3d of the same name beside it",
                "AMASS's SMPL-H release has them; the SMPL-X release does not",
            )
        archive.check(keys[0], MOST_FRAMES * _MOST_MARKERS * 3 * 8)
        archive.check(keys[1], 1 << 20)
        points, labels = (archive.array(key) for key in keys)
        vertices = None
        if _VERTICES in archive and archive[_VERTICES].dtype.hasobject and _is_smpl(archive):
            with archive.member(_VERTICES) as stream:
                vertices = load_restricted_item(stream)
    if labels.dtype.kind not in "US":
        raise refused(path, f"names of type {labels.dtype}", "text")
    return _stored(path, points, labels.ravel().tolist(), vertices)


def _keys(archive: UntrustedNpz) -> tuple[str, str] | None:
    return next((keys for keys in _KEYS if all(key in archive for key in keys)), None)


def _is_smpl(archive: UntrustedNpz) -> bool:
    """Whether its pose is of a body with SMPL's vertices; SMPL-X has others."""
    return "poses" in archive and archive["poses"].shape[-1:] != _SMPLX_POSE


def read_mosh(path: Path) -> Stored:
    """The markers of `stageii_debug_details`, and the vertices that MoSh++ found for them."""
    _, people = opened(path)
    fields = people[0] if people else {}
    details = fields.get("stageii_debug_details")
    points, labels = (within(details, key) for key in ("markers_orig", "labels_orig"))
    if points is None or labels is None:
        raise refused(
            path,
            "a result of MoSh++ without 'markers_orig' and 'labels_orig'",
            "the markers that it was fitted to, in stageii_debug_details",
            "Run MoSh++ again, or put the .c3d beside its .npz",
        )
    names = labels if isinstance(labels, list) else as_array(labels).ravel().tolist()
    vertices = fields.get(_VERTICES, within(fields.get("marker_meta"), "marker_vids"))
    is_smpl = as_array(fields["fullpose"]).shape[-1:] != _SMPLX_POSE
    return _stored(path, as_array(points), names, vertices if is_smpl else None)


def _stored(path: Path, points: NDArray, labels: list, vertices: object) -> Stored:
    names = [one.decode(errors="replace") if isinstance(one, bytes) else one for one in labels]
    if not all(isinstance(name, str) for name in names):
        raise refused(path, "names of markers that are no text", "text")
    return Stored(points, names, vertices=vertices if isinstance(vertices, dict) else {})


def read_c3d(path: Path) -> Stored:
    """Labelled points; those that are angles or forces are left out."""
    with open_regular(path, _MOST_BYTES) as file:
        raw = file.read()
    if len(raw) < 2 * _BLOCK or raw[1] != 0x50:
        raise ValueError("no C3D")
    begins = (raw[0] - 1) * _BLOCK
    if begins < _BLOCK or len(raw) < begins + 4 or raw[begins + 3] not in _NUMBERS:
        raise ValueError("a C3D of no known processor")
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
    return Stored(points[:, kept], [labels[n] for n in kept], file.fps, per_m, upright=False)


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
        found = self._floats(raw) if kind == 4 else np.frombuffer(raw, f"{self._order}u2")
        return found if kind in (2, 4) and len(found) else np.array([otherwise])

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
        # What is longer than 65,535 frames says so elsewhere, each writer in its own way.
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
        found = np.frombuffer(raw, f"{self._order}f4")
        if self._dec:  # halves the other way round, and four times as large
            found = np.ascontiguousarray(found.view("<u2").reshape(-1, 2)[:, ::-1]).view("<f4")
            per_one = 4
        with np.errstate(invalid="ignore"):  # of some numbers that are none
            return found.ravel().astype(np.float64) / per_one

    def _parameters(self, begins: int) -> Iterator[tuple[str, tuple[int, tuple[int, ...], bytes]]]:
        """Name, type, sizes and bytes of those of the group POINT."""
        found: list[tuple[int, str, tuple[int, tuple[int, ...], bytes]]] = []
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
                found.append((group, name, (kind, sizes, data)))
            if further <= 0:
                break
            at += further
        yield from ((name, value) for group, name, value in found if groups.get(group) == "POINT")
