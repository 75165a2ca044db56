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
        self._gui, self._panel, self._plot = gui, gui.add_panel(visible=False), None
        self._tab = self._panel.add_tab("Error over time", viser.Icon.CHART_LINE)
        self._panel.float(x=15, y=-15, width=_WIDTH_PX)
        self._curves: dict[str, NDArray] = {}

    def show(self, curves_m: Mapping[str, NDArray], time_s: float, fps: float) -> None:
        """Show errors (T,) by label, in metres; none at all hides the window."""
        if not curves_m:
            self._panel.visible = False
            self._curves = {}
            return
        changed = [id(curve) for curve in curves_m.values()] != list(map(id, self._curves.values()))
        if changed or list(curves_m) != list(self._curves):
            self._curves = dict(curves_m)
            self._draw(time_s, fps)
            self._panel.visible = True
        elif self._plot is not None:
            self._plot.data = self._data(time_s, fps)

    def _data(self, time_s: float, fps: float) -> tuple[NDArray[np.float64], ...]:
        """Time, the part of it that has passed as a step down at the present, and the errors."""
        curves_mm = [1000.0 * curve.astype(np.float64) for curve in self._curves.values()]
        times_s = np.arange(len(curves_mm[0])) / fps
        top = max(curve.max() for curve in curves_mm)
        return times_s, np.where(times_s <= time_s, top, 0.0), *curves_mm

    def _draw(self, time_s: float, fps: float) -> None:
        if self._plot is not None:
            self._plot.remove()
        curves: list[uplot.Series] = [
            {"label": label, "stroke": _STROKES[number % len(_STROKES)], "width": 2}
            for number, label in enumerate(self._curves)
        ]
        passed: uplot.Series = {"label": "now", "stroke": "#00000040", "fill": "#00000010"}
        axes: tuple[uplot.Axis, ...] = (
            {},
            {"label": "mm", "size": 40},
        )
        with self._tab:
            self._plot = self._gui.add_uplot(
                self._data(time_s, fps),
                ({"label": "time, s"}, passed, *curves),
                scales={"x": {"time": False}},
                axes=axes,
                title=_TITLE,
                height=_HEIGHT_PX,
            )
