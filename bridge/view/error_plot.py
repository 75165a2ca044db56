"""Error over time, under the bodies: a curve for each, and where in time one is."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import viser
from numpy.typing import NDArray
from viser import uplot

_STROKES = ("#777777", "#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#8c564b")
_TITLE = "Mean distance to the true mesh"
_HEIGHT_PX, _WIDTH_PX = 150, 560


class ErrorPlot:
    """A window over the lower edge of the scene, where errors are known."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._gui, self._panel = gui, gui.add_panel(visible=False)
        self._tab = self._panel.add_tab("Error over time", viser.Icon.CHART_LINE)
        self._panel.float(x=15, y=-15, width=_WIDTH_PX)
        self._plots: dict[tuple[str, ...], viser.GuiUplotHandle] = {}

    def show(self, curves_m: Mapping[str, NDArray], time_s: float, fps: float) -> None:
        """Show errors (T,) by label, in metres; none at all hides the window."""
        if self._panel.visible != bool(curves_m):
            self._panel.visible = bool(curves_m)
        if not curves_m:
            return
        data = _data(curves_m, time_s, fps)
        # One for each set of curves, and hidden, not removed, when another one's turn comes: a
        # browser may still be getting news of it.
        labels = tuple(curves_m)
        for other, plot in self._plots.items():
            if plot.visible != (other == labels):
                plot.visible = other == labels
        if labels in self._plots:
            self._plots[labels].data = data
        else:
            self._plots[labels] = self._draw(labels, data)

    def _draw(
        self, labels: tuple[str, ...], data: tuple[NDArray[np.float64], ...]
    ) -> viser.GuiUplotHandle:
        curves: list[uplot.Series] = [
            {"label": label, "stroke": _STROKES[number % len(_STROKES)], "width": 2}
            for number, label in enumerate(labels)
        ]
        passed: uplot.Series = {"label": "now", "stroke": "#00000040", "fill": "#00000010"}
        axes: tuple[uplot.Axis, ...] = (
            {},
            {"label": "mm", "size": 40},
        )
        with self._tab:
            return self._gui.add_uplot(
                data,
                ({"label": "time, s"}, passed, *curves),
                scales={"x": {"time": False}},
                axes=axes,
                title=_TITLE,
                height=_HEIGHT_PX,
            )


def _data(
    curves_m: Mapping[str, NDArray], time_s: float, fps: float
) -> tuple[NDArray[np.float64], ...]:
    """Time, the part of it that has passed as a step down at the present, and the errors."""
    curves_mm = [1000.0 * curve.astype(np.float64) for curve in curves_m.values()]
    times_s = np.arange(len(curves_mm[0])) / fps
    top = max(curve.max() for curve in curves_mm)
    return times_s, np.where(times_s <= time_s, top, 0.0), *curves_mm
