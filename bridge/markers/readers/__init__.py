"""Files of optical markers: one module a format. A new one is a module here and its line."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from bridge.markers.readers import amass, c3d, mosh
from bridge.markers.stored import Stored


class MarkerReader(Protocol):
    """What a module of this folder has."""

    def sniff(self, path: Path) -> bool:
        """Whether a file is for this reader: by its name."""
        ...

    def has_markers(self, path: Path) -> bool:
        """Whether there are any, by as few bytes as possible."""
        ...

    def read(self, path: Path) -> Stored:
        """Read them; `DsnetError`, or what `bridge.runs.untrusted` calls damage."""
        ...


READERS: dict[str, MarkerReader] = {"amass": amass, "mosh": mosh, "c3d": c3d}
"""What none of them knows is refused in the words of the first."""


def reader_of(path: Path) -> MarkerReader:
    """Whose file it is."""
    return next((one for one in READERS.values() if one.sniff(path)), amass)
