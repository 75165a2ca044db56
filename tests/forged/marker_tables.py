"""Markers in tables of text, as OpenSim, Qualisys and OptiTrack write them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def _row(places: NDArray, unseen: str) -> list[str]:
    """Of one frame (N, 3)."""
    return [unseen if np.isnan(number) else f"{number:.5f}" for number in places.ravel()]


def trc(
    points: NDArray, labels: Sequence[str], fps: float = 60.0, units: str = "mm", unseen: str = ""
) -> str:
    """OpenSim's, of points (T, N, 3); NaN is what was not seen."""
    lines = [
        ["PathFileType", "4", "(X/Y/Z)", "walk.trc"],
        ["DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units", "OrigDataRate"],
        [f"{fps:.2f}", f"{fps:.2f}", str(len(points)), str(len(labels)), units, f"{fps:.2f}"],
        ["Frame#", "Time", *(cell for label in labels for cell in (label, "", ""))],
        ["", "", *(f"{axis}{n + 1}" for n in range(len(labels)) for axis in "XYZ")],
        [],
        *([str(t + 1), f"{t / fps:.5f}", *_row(one, unseen)] for t, one in enumerate(points)),
    ]
    return "\n".join("\t".join(line) for line in lines) + "\n"


def qualisys(
    points: NDArray,
    labels: Sequence[str],
    fps: float = 60.0,
    unseen: str = "0.000",
    with_times: bool = False,
) -> str:
    """Qualisys' TSV, in millimetres; with frames and times from version 2.14 on."""
    lines = [
        *(["NO_OF_FRAMES", str(len(points))], ["NO_OF_CAMERAS", "8"]),
        *(["NO_OF_MARKERS", str(len(labels))], ["FREQUENCY", f"{fps:g}"], ["NO_OF_ANALOG", "0"]),
        *(["DESCRIPTION", "--"], ["TIME_STAMP", "2020-01-01, 10:00:00", "3"]),
        *(["DATA_INCLUDED", "3D"], ["MARKER_NAMES", *labels]),
    ]
    if with_times:
        lines += [["TRAJECTORY_TYPES", *(["Measured"] * len(labels))]]
        lines += [["Frame", "Time", *(f"{label} {axis}" for label in labels for axis in "XYZ")]]
    for t, one in enumerate(points):
        lines.append([*([str(t + 1), f"{t / fps:.5f}"] if with_times else []), *_row(one, unseen)])
    return "\r\n".join("\t".join(line) for line in lines) + "\r\n"


def optitrack(points: NDArray, labels: Sequence[str], fps: float = 60.0) -> str:
    """OptiTrack's CSV, metres: a bone, each marker as it was seen and as it was solved, and one
    without a name."""
    columns = [
        ("Bone", "Anna:Hip", "Rotation"), ("Bone", "Anna:Hip", "Position"),
        *(("Bone Marker", f"Anna:{label}", "Position") for label in labels),
        *(("Marker", f"Anna:{label}", "Position") for label in labels),
        ("Marker", "Unlabeled 1207", "Position"),
    ]  # fmt: skip
    heads = zip(("Type", "Name", ""), zip(*columns, strict=True), strict=True)
    lines = [
        ["Format Version", "1.23", "Take Name", "walk", "Capture Frame Rate", f"{fps:.6f}",
         "Export Frame Rate", f"{fps:.6f}", "Length Units", "Meters"],
        [],
        *(["", name, *(h for h in head for _ in range(3))] for name, head in heads),
        ["Frame", "Time (Seconds)", *("XYZ" * len(columns))],
    ]  # fmt: skip
    for t, one in enumerate(points):
        solved, other = one + 0.01, np.ones((1, 3))
        row = _row(np.concatenate([0 * other, other, solved, one, other]), "")
        lines.append([str(t), f"{t / fps:.6f}", *row])
    return "\n".join(",".join(line) for line in lines) + "\n"
