"""Markers that a motion's pose was fitted to, as their file has them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.runs.untrusted import file_refused

_REMEDY = "Pass a file with skin markers"


@dataclass(frozen=True, eq=False)
class StoredMarkers:
    """Labelled points, not checked yet."""

    points: NDArray
    """(T, N, 3) numbers, zero or NaN where a marker was not seen."""
    labels: list[str]
    fps: float | None = None
    """None: a row for each frame of the pose."""
    per_m: float | None = None
    """Units in a metre; None where the file does not say."""
    upright: bool = True
    """Whether they are z up, as the pose that was fitted to them; else their axes say nothing."""
    vertices: Mapping[str, int] = field(default_factory=dict)
    """Of SMPL, by label, where the file has them."""


@dataclass(frozen=True, eq=False)
class MarkerFile:
    """Where a motion's markers are. Nobody else opens the file for them."""

    path: Path
    read: Callable[[Path], StoredMarkers]

    @cached_property
    def stored(self) -> StoredMarkers:
        """The markers, read when they are first needed: most motions are used without them.

        `DsnetError` if the file is damaged or has no such markers.
        """
        with marker_file_refused(self.path):
            return self.read(self.path)


def refused(path: Path, received: str, expected: str, remedy: str = _REMEDY) -> DsnetError:
    """The refusal of a file's markers."""
    return DsnetError(f"{path}, {received}", expected, f"{remedy}.")


def marker_file_refused(path: Path) -> AbstractContextManager[None]:
    """The same of what cannot be read."""
    return file_refused(path, lambda p, flaw, remedy: refused(p, flaw, "markers", remedy), _REMEDY)
