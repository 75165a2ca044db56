"""One motion as a row of posed bodies, coloured by the size of their skin offsets."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from bridge.report.panels import (
    add_colour_bar,
    magnitude_colours,
    new_figure,
    save_figure,
    scale_top_m,
)
from bridge.report.render import frame_camera, render_bodies
from bridge.runs.artifact import DataOrigin

_GAP_M = 0.12


def draw_motion_strip(
    path: Path,
    vertices_m: ArrayLike,
    offsets_m: ArrayLike,
    faces: ArrayLike,
    *,
    origin: DataOrigin,
    fps: float = 60.0,
    title: str = "Predicted skin offsets along the motion",
    bodies: int = 8,
    width_px: int = 1300,
) -> None:
    """Write a PNG of evenly spaced frames side by side; colour is the offset's magnitude.

    Parameters
    ----------
    vertices_m : (T, V, 3) posed vertices, metres, y up; may be memory-mapped.
    offsets_m : (T, V, 3) offsets in the rest pose, metres.
    faces : (F, 3) vertex indices.
    """
    total = np.shape(vertices_m)[0]
    frames = np.unique(np.linspace(0, total - 1, min(bodies, total)).round().astype(int))
    draw_row_of_bodies(
        path,
        np.asarray(vertices_m)[frames],
        np.linalg.norm(np.asarray(offsets_m)[frames], axis=-1),
        faces,
        labels=[f"{time_s:.2f} s" for time_s in frames / fps],
        origin=origin,
        title=title,
        width_px=width_px,
    )


def draw_row_of_bodies(
    path: Path,
    vertices_m: ArrayLike,
    magnitude_m: ArrayLike,
    faces: ArrayLike,
    *,
    labels: Sequence[str],
    origin: DataOrigin,
    title: str,
    width_px: int = 1300,
    width_in: float = 12.0,
) -> None:
    """Write a PNG of bodies side by side, each coloured by the magnitude of its offsets.

    Each body stands in a place of its own: its travel along the floor is taken out, its height
    above the floor is kept, so a jump is seen as one.

    Parameters
    ----------
    vertices_m : (N, V, 3) posed vertices, metres, y up.
    magnitude_m : (N, V) what the colour shows, metres.
    labels : what stands below each body.
    width_in : of the page; the narrower, the larger are letters beside the bodies.
    """
    row = _side_by_side(np.asarray(vertices_m, dtype=np.float64))
    magnitude_m = np.asarray(magnitude_m)
    top_m = scale_top_m(magnitude_m)
    camera = frame_camera(list(row), height_px=_height_px(row, width_px), azimuth_deg=0.0)
    picture = render_bodies(
        list(row),
        faces,
        camera=camera,
        colours=list(magnitude_colours(magnitude_m, top_m)),
    )
    figure = new_figure(width_in, _height_in(picture, width_in), title=title, origin=origin)
    _write(path, figure, picture, labels, row, top_m)


def _side_by_side(posed: NDArray[np.float64]) -> NDArray[np.float64]:
    """Bodies (N, V, 3) moved along x until none overlaps, each above one line on the floor."""
    low, high = posed[..., 0].min(axis=1), posed[..., 0].max(axis=1)
    start = np.concatenate([[0.0], np.cumsum(high - low + _GAP_M)[:-1]])
    row = posed.copy()
    row[..., 0] += (start - low)[:, None]
    row[..., 2] -= posed[..., 2].mean(axis=1, keepdims=True)
    return row


def _height_px(row: NDArray[np.float64], width_px: int) -> int:
    size = np.ptp(row.reshape(-1, 3), axis=0)
    return int(width_px * (size[1] + 0.35 * size[2]) / size[0]) + 1


def _height_in(picture: NDArray[np.uint8], width_in: float) -> float:
    height, width = picture.shape[:2]
    return width_in * height / width * 0.92 + 0.9


def _write(
    path: Path,
    figure: Figure,
    picture: NDArray[np.uint8],
    labels: Sequence[str],
    row: NDArray[np.float64],
    top_m: float,
) -> None:
    width = picture.shape[1]
    axes = figure.subplots()
    axes.imshow(picture, interpolation="antialiased")
    span = row[..., 0].min(), row[..., 0].max()
    middles = (row[..., 0].min(axis=1) + row[..., 0].max(axis=1)) / 2
    border = 0.5 * 0.08 / 1.08 * width
    places = border + (middles - span[0]) / (span[1] - span[0]) * (width - 2 * border)
    axes.set_xticks(places, labels, fontsize=8)
    axes.set_yticks([])
    axes.tick_params(length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)
    add_colour_bar(figure, [axes], top_m, "skin offset")
    save_figure(figure, path)
