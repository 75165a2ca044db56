"""Figures with a footer about their data, and rows of bodies coloured by offset length."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from textwrap import fill

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from bridge.runs.artifact import DataShown
from dsnet.pictures.render import frame_camera, render_bodies

# Perceptually uniform, and light at zero, so that a body without offsets looks like a body.
MAGNITUDE_COLOURS = ListedColormap(colormaps["magma_r"](np.linspace(0.03, 0.85, 256)))
FOOTERS = {
    "synthetic": "synthetic: body model and soft tissue are computed, no skin was measured",
    "synthetic flesh": "soft tissue is computed, no skin was measured; the body model is licensed",
    "licensed": "made from licensed body model and meshes",
}
_DPI = 150
_GAP_M = 0.12
_STRIP_BODIES = 8


def footer(origin: DataShown, recorded: str = "") -> str:
    """The footer of a picture: the kind of data, and the source of a recorded motion."""
    return f"{FOOTERS[origin]}; motion recorded: {recorded}" if recorded else FOOTERS[origin]


def magnitude_colours(magnitude_m: ArrayLike, top_m: float) -> NDArray[np.float64]:
    """sRGB colours (..., 3) of magnitudes (...), metres; the darkest at `top_m` and above."""
    return MAGNITUDE_COLOURS(np.clip(np.asarray(magnitude_m) / top_m, 0.0, 1.0))[..., :3]


def scale_top_m(magnitude_m: ArrayLike) -> float:
    """The top of a colour scale, metres: a round number above the 99.8 % quantile."""
    value = max(float(np.quantile(np.asarray(magnitude_m), 0.998)), 1e-4)
    decade = float(10.0 ** np.floor(np.log10(value)))
    return decade * next(s for s in (1, 1.5, 2, 3, 4, 5, 6, 8, 10) if s * decade >= value)


def new_figure(width_in: float, height_in: float, *, title: str, origin: DataShown) -> Figure:
    """A figure that says in its footer what kind of data it shows."""
    figure = Figure(figsize=(width_in, height_in), dpi=_DPI, layout="constrained")
    # Constrained layout leaves room for title and footer.
    figure.suptitle(title, fontsize=11, fontweight="bold")
    figure.supxlabel(FOOTERS[origin], fontsize=7.5, color="#8a4b00", style="italic")
    return figure


def save_figure(figure: Figure, path: Path) -> None:
    """Write a PNG whose bytes depend on the figure only."""
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Software": None})


def draw_panels(
    path: Path,
    pictures: Sequence[Sequence[NDArray[np.uint8]]],
    *,
    title: str,
    origin: DataShown,
    column_titles: Sequence[str],
    row_titles: Sequence[str],
    colour_top_m: float,
    colour_label: str,
    width_in: float = 9.0,
    framed: Collection[tuple[int, int]] = (),
) -> None:
    """Write a grid of pictures with a colour bar from 0 to `colour_top_m` in centimetres.

    Pictures whose (row, column) is in `framed` get a frame.
    """
    rows, columns = len(pictures), len(pictures[0])
    height, width = pictures[0][0].shape[:2]
    panel_in = (width_in - 1.5) / columns
    height_in = rows * panel_in * height / width + 0.95
    figure = new_figure(width_in, height_in, title=title, origin=origin)
    axes = figure.subplots(rows, columns, squeeze=False)
    for row, line in enumerate(pictures):
        for column, picture in enumerate(line):
            _show(axes[row, column], picture, framed=(row, column) in framed)
            if row == 0:
                axes[row, column].set_title(fill(column_titles[column], 18), fontsize=9)
        axes[row, 0].set_ylabel(fill(row_titles[row], 18), fontsize=9)
    _add_colour_bar(figure, list(axes.flat), colour_top_m, colour_label)
    save_figure(figure, path)


def draw_motion_strip(
    path: Path,
    vertices_m: ArrayLike,
    offsets_m: ArrayLike,
    faces: ArrayLike,
    *,
    origin: DataShown,
    width_px: int = 1300,
) -> None:
    """Write a PNG of up to eight evenly spaced frames side by side, coloured by offset length.

    Vertices, posed and y up, and offsets in the rest pose are (T, V, 3), metres, 60 fps, and may
    be memory-mapped; faces are (F, 3).
    """
    total = np.shape(vertices_m)[0]
    frames = np.unique(np.linspace(0, total - 1, min(_STRIP_BODIES, total)).round().astype(int))
    draw_row_of_bodies(
        path,
        np.asarray(vertices_m)[frames],
        np.linalg.norm(np.asarray(offsets_m)[frames], axis=-1),
        faces,
        labels=[f"{time_s:.2f} s" for time_s in frames / 60.0],
        origin=origin,
        title="Predicted skin offsets along the motion",
        width_px=width_px,
    )


def draw_row_of_bodies(
    path: Path,
    vertices_m: ArrayLike,
    magnitude_m: ArrayLike,
    faces: ArrayLike,
    *,
    labels: Sequence[str],
    origin: DataShown,
    title: str,
    width_px: int = 1300,
    width_in: float = 12.0,
) -> None:
    """Write a PNG of bodies (N, V, 3) side by side, coloured by magnitude (N, V), metres.

    Travel along the floor is removed, height above the floor is kept, so that a jump looks like
    one. `labels` are written below the bodies; a smaller page (`width_in`) has larger letters.
    """
    posed = np.asarray(vertices_m, dtype=np.float64)
    low, high = posed[..., 0].min(axis=1), posed[..., 0].max(axis=1)
    start = np.concatenate([[0.0], np.cumsum(high - low + _GAP_M)[:-1]])
    row = posed.copy()
    row[..., 0] += (start - low)[:, None]
    row[..., 2] -= posed[..., 2].mean(axis=1, keepdims=True)
    size_m = np.ptp(row.reshape(-1, 3), axis=0)
    height_px = int(width_px * (size_m[1] + 0.35 * size_m[2]) / size_m[0]) + 1
    top_m = scale_top_m(magnitude_m)
    picture = render_bodies(
        list(row),
        faces,
        camera=frame_camera(list(row), height_px=height_px, azimuth_deg=0.0),
        colours=list(magnitude_colours(magnitude_m, top_m)),
    )
    height, width = picture.shape[:2]
    height_in = width_in * height / width * 0.92 + 0.9
    figure = new_figure(width_in, height_in, title=title, origin=origin)
    axes = figure.subplots()
    _show(axes, picture)
    middles = start + (high - low) / 2
    border = 0.5 * 0.08 / 1.08 * width
    places = border + middles / size_m[0] * (width - 2 * border)
    axes.set_xticks(places, labels, fontsize=8)
    axes.tick_params(length=0)
    _add_colour_bar(figure, [axes], top_m, "skin offset")
    save_figure(figure, path)


def _add_colour_bar(figure: Figure, axes: Sequence[Axes], top_m: float, label: str) -> None:
    """Add a colour bar from 0 to `top_m`, in centimetres like the paper's."""
    scale = ScalarMappable(Normalize(0.0, 100 * top_m), MAGNITUDE_COLOURS)
    bar = figure.colorbar(scale, ax=axes, fraction=0.025, pad=0.01, aspect=30, extend="max")
    bar.set_label(f"{label} [cm]", fontsize=9)
    bar.ax.tick_params(labelsize=8)


def _show(axes: Axes, picture: NDArray[np.uint8], *, framed: bool = False) -> None:
    axes.imshow(picture, interpolation="antialiased")
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(framed)
