"""Markers in tables of text: OpenSim's TRC, Qualisys' TSV, and OptiTrack's CSV.

Their vertical is not said. A blank, `nan`, or three zeros are a marker that was not seen.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.motion.markers import StoredMarkers
from bridge.motion.motion import MOST_FRAMES, RATES_HZ
from bridge.runs.untrusted import open_regular

_MOST_BYTES, _MOST_MARKERS = 1 << 29, 500
_LONGEST_HEADER = 60
"""Lines before the numbers."""
_PER_M = {"mm": 1e3, "millimeters": 1e3, "cm": 1e2, "centimeters": 1e2, "m": 1.0, "meters": 1.0}
_UNSEEN = ("", "nan", "null", "n/a", "-nan", "-nan(ind)")
Rows = Sequence[list[str]]


def read_text(path: Path) -> StoredMarkers:
    """Labelled points of one of these tables; ValueError if it is none of them."""
    with open_regular(path, _MOST_BYTES) as file:
        raw = file.read()
    wide = raw[:2] in (b"\xff\xfe", b"\xfe\xff")
    text = raw.decode("utf-16" if wide else "utf-8-sig", errors="replace")
    lines = text.splitlines()
    begins = text[:40].lstrip().lower()
    if begins.startswith("pathfiletype"):
        return _trc(_cells(lines))
    if begins.startswith("no_of_frames"):
        return _qualisys(_cells(lines))
    if begins.startswith(("format version", "take name")):
        return _optitrack(_cells(lines))
    raise ValueError("no table of markers as OpenSim, Qualisys or OptiTrack write it")


def _cells(lines: list[str]) -> Rows:
    """Each line's, without blanks; columns are divided by tabs, else by commas, else by blanks."""
    whole = "\n".join(lines[:_LONGEST_HEADER])
    if "\t" in whole or "," not in whole:
        split = "\t" if "\t" in whole else None
        return [[cell.strip() for cell in line.split(split)] for line in lines]
    return [[cell.strip() for cell in row or [""]] for row in csv.reader(lines)]


def _trc(rows: Rows) -> StoredMarkers:
    stated = dict(zip(*rows[1:3], strict=False))
    names = [cell for cell in rows[3][2:] if cell]
    begins = 5 if any(cell[:1].upper() == "X" for cell in rows[4]) else 4
    points = _points(rows[begins:], begins, range(2, 2 + 3 * len(names), 3))
    if (count := int(stated.get("NumFrames") or 0)) > len(points):
        raise ValueError(f"a TRC of {count} frames with {len(points)}")
    return _stored(points, names, stated.get("DataRate"), stated.get("Units"))


def _qualisys(rows: Rows) -> StoredMarkers:
    stated = {row[0].upper(): row[1:] for row in rows[:_LONGEST_HEADER] if row[0]}
    names = [name for name in stated.get("MARKER_NAMES", []) if name]
    if not names:
        raise ValueError("a table of Qualisys without MARKER_NAMES")
    after = next(n for n, row in enumerate(rows) if row[0].upper() == "MARKER_NAMES") + 1
    is_text = [row[0][:1].isalpha() and row[0].lower() not in _UNSEEN for row in rows[after:]]
    begins = after + is_text.index(False)
    heads = {cell.upper() for cell in rows[begins - 1][:2]} & {"FRAME", "TIME"}
    width = len(rows[begins]) - (rows[begins][-1] == "")
    lead = len(heads) or max(0, width - 3 * len(names))
    points = _points(rows[begins:], begins, range(lead, lead + 3 * len(names), 3))
    if (count := int(stated["NO_OF_FRAMES"][0])) > len(points):
        raise ValueError(f"a table of {count} frames with {len(points)}")
    return _stored(points, names, stated.get("FREQUENCY", [""])[0], "mm")


def _optitrack(rows: Rows) -> StoredMarkers:
    stated = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    heads = {row[1].lower(): row for row in rows[1:_LONGEST_HEADER] if len(row) > 2 and row[1]}
    begins = next((n for n, row in enumerate(rows[:_LONGEST_HEADER]) if row[0] == "Frame"), 0)
    if not begins or not {"type", "name"} <= heads.keys():
        raise ValueError("a table of OptiTrack without rows of types and names")
    axes, what = rows[begins], rows[begins - 1]
    columns: dict[str, int] = {}
    for kind in ("marker", "rigid body marker", "bone marker"):  # the seen ones before the solved
        for column, name in enumerate(heads["name"]):
            is_place = [row[column].lower() for row in (heads["type"], what, axes)]
            if is_place == [kind, "position", "x"] and not name.lower().startswith("unlabeled"):
                columns.setdefault(name, column)
    points = _points(rows[begins + 1 :], begins + 1, [*columns.values()])
    rate = stated.get("Export Frame Rate") or stated.get("Capture Frame Rate")
    return _stored(points, [*columns], rate, stated.get("Length Units"))


def _stored(
    points: NDArray, names: list[str], rate: str | None, units: str | None
) -> StoredMarkers:
    fps = _number(rate or "")
    if not RATES_HZ[0] <= fps <= RATES_HZ[1]:
        raise ValueError(f"a table at {rate!r} frames a second")
    return StoredMarkers(points, names, fps, _PER_M.get((units or "").lower()), upright=False)


def _points(rows: Iterable[list[str]], before: int, columns: Sequence[int]) -> NDArray[np.float64]:
    """(T, N, 3) from rows of cells, of whose markers X stands in one of N columns each."""
    if not 0 < len(columns) <= _MOST_MARKERS:
        raise ValueError(f"a table of {len(columns)} markers")
    wanted = [at for column in columns for at in range(column, column + 3)]
    found, most = [], max(wanted) + 1
    for line, row in enumerate(islice(rows, MOST_FRAMES + _LONGEST_HEADER), before + 1):
        if not any(row):
            continue
        cells = row + [""] * (most - len(row))
        try:
            found.append(np.array([_number(cells[at]) for at in wanted]))
        except ValueError as error:
            raise ValueError(f"line {line}: {error}") from None
    if not 0 < len(found) <= MOST_FRAMES:
        raise ValueError(f"a table of {len(found)} frames")
    points = np.stack(found).reshape(len(found), -1, 3)
    points[~np.isfinite(points).all(axis=2)] = np.nan
    return points


def _number(cell: str) -> float:
    """NaN of what says that there is none."""
    if cell.lower() in _UNSEEN:
        return math.nan
    try:
        return float(cell.replace(",", "."))  # of Europe's tables, whose columns tabs divide
    except ValueError:
        raise ValueError(f"{cell[:20]!r} is no number") from None
