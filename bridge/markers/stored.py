"""Markers as a file has them, and the refusal of one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from numpy.typing import NDArray

from bridge.errors import DsnetError


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
