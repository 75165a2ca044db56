"""A viewer: one thread passes the time and draws what the controls ask for."""

from __future__ import annotations

import threading
import time

import numpy as np
import viser
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.view.error_plot import ErrorPlot
from bridge.view.live_scene import LiveScene
from bridge.view.panel import Panel
from bridge.view.performances import LABELS, SMPL_ALONE, Performances
from bridge.view.recording import record
from bridge.view.selection import Selection, Shown
from bridge.view.timeline import Timeline
from bridge.view.truth import TRUTH

_DRAWN_HZ = 30.0


def first_selection(performances: Performances) -> Selection:
    """What is shown at the start: SMPL alone, the best predictor, and the truth where known."""
    repertoire = performances.repertoire
    take, best = next(iter(repertoire.takes)), next(iter(repertoire.predictors))
    known = (TRUTH,) if repertoire.takes[take].truth is not None else ()
    return Selection(take, performances.own_betas(take), (SMPL_ALONE, best, *known))


class Viewer:
    """Everything behind one page: call `draw` again and again, or `run` until it is stopped."""

    def __init__(self, server: viser.ViserServer, performances: Performances) -> None:
        self.performances = performances
        repertoire, selection = performances.repertoire, first_selection(performances)
        self._shown = Shown(performances, selection)
        self.timeline = Timeline(self._shown.frames)
        self.scene = LiveScene(server, repertoire.body.faces, repertoire.origin)
        self.scene.frame_bodies(len(self._shown.asked))
        self.panel = Panel(server, performances, selection, self.timeline, self._recording)
        self._plot = ErrorPlot(server.gui)
        self._problem, self._stopped = "", threading.Event()

    def _recording(self, selection: Selection) -> str:
        return record(self.performances, selection)

    def run(self) -> None:
        """Draw until `stop` is called."""
        last_s = time.monotonic()
        while not self._stopped.is_set():
            now_s = time.monotonic()
            self.draw(now_s - last_s)
            last_s = now_s
            self._stopped.wait(max(1 / _DRAWN_HZ - (time.monotonic() - now_s), 0.001))

    def stop(self) -> None:
        """End `run`."""
        self._stopped.set()

    def draw(self, passed_s: float) -> None:
        """Let time pass and draw the bodies as they are then."""
        self._follow(self.panel.selection)
        frame, shown = self.timeline.pass_time(passed_s), self._shown
        self.scene.draw(list(shown.posed(frame)), shown.selection)
        self._plot.show(self._curves(), self.timeline.time_s, self.timeline.fps)
        self.panel.tell(frame, self._status())

    def _follow(self, selection: Selection) -> None:
        """Show what is chosen now; what cannot be read stays as it was, and one line says why."""
        before = self._shown.selection
        if selection == before:
            return
        try:
            self._shown, self._problem = Shown(self.performances, selection), ""
        except DsnetError as error:
            self._problem = str(error)
        if self._shown.selection.take != before.take:
            motion = self.performances.motion(selection.take, selection.betas)
            self.timeline.begin(self._shown.frames, motion.fps)
            self.panel.begin(self._shown.frames)

    def _curves(self) -> dict[str, NDArray[np.float32]]:
        gain = self._shown.selection.gain
        labels = {**LABELS, **self.performances.repertoire.predictors}
        found = {asked: self.performances.errors_m(asked, gain) for asked in self._shown.asked}
        return {labels[a.predictor]: curve for a, curve in found.items() if curve is not None}

    def _status(self) -> str:
        if self._problem:
            return self._problem
        ready = self._shown.ready()
        seconds = (
            f"{self.timeline.time_s:.2f} s of {self.timeline.frames / self.timeline.fps:.2f} s"
        )
        return seconds if ready == 1.0 else f"{seconds}; computing, {ready:.0%} done"
