"""A viewer, which draws what its controls ask for as time passes, and recordings of it."""

from __future__ import annotations

import io
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, redirect_stdout

import numpy as np
import viser
from numpy.typing import NDArray
from viser import uplot

from bridge.errors import DsnetError
from bridge.runtime.controls import Controls, gains_of_parts
from bridge.view.live_scene import LiveScene
from bridge.view.panel import Panel, Timeline
from bridge.view.performances import Gains, Performances
from bridge.view.repertoire import AS_ASKED, LABELS, SMPL_ALONE, TRUTH
from bridge.view.selection import Selection, Shown

RECORDED_FPS = 30.0
"""Frames a second of a recording: every second one of a motion."""
_STROKES = ("#777777", "#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#8c564b")
_PLOT_PX = 560, 150


@contextmanager
def serving(host: str, port: int) -> Iterator[viser.ViserServer]:
    """A server while the block runs, at any free port where it is 0, that says nothing itself."""
    # What viser prints, it prints whether told to be quiet or not.
    with redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host, port, verbose=False)
    try:
        yield server
    finally:
        with redirect_stdout(io.StringIO()):
            server.stop()


def first_selection(performances: Performances, controls: Controls | None = None) -> Selection:
    """What is shown at the start: SMPL alone, the best predictor, and the truth where known.

    `controls` are those with which the repertoire was opened.
    """
    repertoire, controls = performances.repertoire, controls or Controls()
    take, best = next(iter(repertoire.takes)), next(iter(repertoire.predictors))
    known = (TRUTH,) if repertoire.takes[take].truth is not None else ()
    own = AS_ASKED not in repertoire.people
    return Selection(
        take,
        performances.own_betas(take) if own else performances.person_betas(AS_ASKED),
        (SMPL_ALONE, best, *known),
        Gains(controls.gain, tuple(map(float, gains_of_parts(controls.part_gain)))),
        controls.floor,
        controls.loop,
    )


def record(performances: Performances, selection: Selection) -> str:
    """One HTML file that plays a selection in any browser, offline, once all of it is computed."""
    shown = Shown(performances, selection)
    performances.worker.wait()
    for asked in shown.asked:
        if failure := performances.worker.failed.get(asked):
            raise failure
    repertoire = performances.repertoire
    # A server of its own: those who look on meanwhile see nothing of it.
    with serving("127.0.0.1", 0) as server:
        scene = LiveScene(server, repertoire.body.faces, repertoire.origin, sparse=False)
        scene.frame_bodies(len(shown.asked))
        scene.draw(list(shown.posed(0)), selection)
        serializer = server.get_scene_serializer()
        step = max(round(performances.motion(selection.way).fps / RECORDED_FPS), 1)
        for frame in range(0, shown.frames, step):
            scene.draw(list(shown.posed(frame)), selection)
            serializer.insert_sleep(1 / RECORDED_FPS)
        return serializer.as_html()


class Viewer:
    """Everything behind one page: call `draw` again and again, or `run` until it is stopped."""

    DRAWN_HZ = 30.0
    """Frames a second that are pushed, at most."""

    def __init__(
        self,
        server: viser.ViserServer,
        performances: Performances,
        controls: Controls | None = None,
    ) -> None:
        self.performances = performances
        repertoire, selection = performances.repertoire, first_selection(performances, controls)
        self._shown, self._followed = Shown(performances, selection), selection
        self.timeline = Timeline(self._shown.frames)
        self.scene = LiveScene(server, repertoire.body.faces, repertoire.origin)
        self.scene.frame_bodies(len(self._shown.asked))

        def recording(selection: Selection) -> str:
            return record(performances, selection)

        self.panel = Panel(server, performances, selection, self.timeline, recording)
        self._plot = ErrorPlot(server.gui)
        self._problem, self._stopped = "", threading.Event()

    def run(self) -> None:
        """Draw until `stop` is called."""
        last_s = time.monotonic()
        while not self._stopped.is_set():
            now_s = time.monotonic()
            self.draw(now_s - last_s)
            last_s = now_s
            self._stopped.wait(max(1 / self.DRAWN_HZ - (time.monotonic() - now_s), 0.001))

    def stop(self) -> None:
        """End `run`."""
        self._stopped.set()

    def draw(self, passed_s: float) -> None:
        """Let time pass and draw the bodies as they are then."""
        self._follow(self.panel.selection)
        frame, shown, timeline = self.timeline.pass_time(passed_s), self._shown, self.timeline
        self.scene.draw(list(shown.posed(frame)), shown.selection)
        labels = {**LABELS, **self.performances.repertoire.predictors}
        gains = shown.selection.gains
        found = {labels[a.predictor]: self.performances.errors_m(a, gains) for a in shown.asked}
        curves_m = {label: curve for label, curve in found.items() if curve is not None}
        self._plot.show(curves_m, timeline.time_s, timeline.fps)
        status = f"{timeline.time_s:.2f} s of {timeline.frames / timeline.fps:.2f} s"
        if (ready := shown.ready()) < 1.0:
            status += f"; computing, {ready:.0%} done"
        self.panel.tell(frame, self._problem or self.panel.problem or status)

    def _follow(self, selection: Selection) -> None:
        """Show what is chosen now; what cannot be read stays as it was, and one line says why."""
        if selection == self._followed:
            return
        self._followed, take, frames = selection, self._shown.selection.take, self._shown.frames
        try:
            self._shown, self._problem = Shown(self.performances, selection), ""
        except DsnetError as error:
            self._problem = str(error)
            return
        count, timeline = self._shown.frames, self.timeline
        if selection.take != take:
            timeline.begin(count, self.performances.motion(selection.way).fps)
        elif count != frames:
            timeline.begin(count, timeline.fps, timeline.frame)
        if count != frames:
            self.panel.begin(count)


class ErrorPlot:
    """A window over the lower edge of the scene: error over time, where errors are known."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._gui, self._panel = gui, gui.add_panel(visible=False)
        self._tab = self._panel.add_tab("Error over time", viser.Icon.CHART_LINE)
        self._panel.float(x=15, y=-15, width=_PLOT_PX[0])
        self._plots: dict[tuple[str, ...], viser.GuiUplotHandle] = {}

    def show(self, curves_m: Mapping[str, NDArray], time_s: float, fps: float) -> None:
        """Show errors (T,) by label, in metres; none at all hides the window."""
        if self._panel.visible != bool(curves_m):
            self._panel.visible = bool(curves_m)
        if not curves_m:
            return
        curves_mm = [1000.0 * curve.astype(np.float64) for curve in curves_m.values()]
        times_s = np.arange(len(curves_mm[0])) / fps
        # The time that has passed is a step down at the present.
        passed = np.where(times_s <= time_s, max(curve.max() for curve in curves_mm), 0.0)
        data = times_s, passed, *curves_mm
        # One for each set of curves, and hidden, not removed, when another one's turn comes: a
        # browser may still be getting news of it.
        labels = tuple(curves_m)
        for other, plot in self._plots.items():
            if plot.visible != (other == labels):
                plot.visible = other == labels
        if labels in self._plots:
            self._plots[labels].data = data
            return
        curves: list[uplot.Series] = [
            {"label": label, "stroke": _STROKES[number % len(_STROKES)], "width": 2}
            for number, label in enumerate(labels)
        ]
        now: uplot.Series = {"label": "now", "stroke": "#00000040", "fill": "#00000010"}
        with self._tab:
            self._plots[labels] = self._gui.add_uplot(
                data,
                ({"label": "time, s"}, now, *curves),
                scales={"x": {"time": False}},
                axes=({}, {"label": "mm", "size": 40}),
                title="Mean distance to the true mesh",
                height=_PLOT_PX[1],
            )
