"""A viewer: one thread passes the time and draws what the controls ask for."""

from __future__ import annotations

import threading
import time

import numpy as np
import viser
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.runtime.controls import Controls, gains_of_parts
from bridge.view.clips import LABELS, SMPL_ALONE, Gains
from bridge.view.error_plot import ErrorPlot
from bridge.view.live_scene import LiveScene
from bridge.view.panel import Panel
from bridge.view.performances import Performances
from bridge.view.recording import record
from bridge.view.repertoire import AS_ASKED
from bridge.view.selection import Selection, Shown
from bridge.view.timeline import Timeline
from bridge.view.truth import TRUTH


def first_selection(performances: Performances, controls: Controls | None = None) -> Selection:
    """What is shown at the start: SMPL alone, the best predictor, and the truth where known.

    Parameters
    ----------
    controls : with which the repertoire was opened; nothing is asked for when None.

    Raises
    ------
    DsnetError
        If a part of the body is unknown.
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
            self._stopped.wait(max(1 / self.DRAWN_HZ - (time.monotonic() - now_s), 0.001))

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
        if selection == self._followed:
            return
        self._followed, take, frames = selection, self._shown.selection.take, self._shown.frames
        try:
            self._shown, self._problem = Shown(self.performances, selection), ""
        except DsnetError as error:
            self._problem = str(error)
            return
        if selection.take != take:
            self.timeline.begin(self._shown.frames, self.performances.motion(selection.way).fps)
        if self._shown.frames != frames:
            self.timeline.take_length(self._shown.frames)
            self.panel.begin(self._shown.frames)

    def _curves(self) -> dict[str, NDArray[np.float32]]:
        gains = self._shown.selection.gains
        labels = {**LABELS, **self.performances.repertoire.predictors}
        found = {asked: self.performances.errors_m(asked, gains) for asked in self._shown.asked}
        return {labels[a.predictor]: curve for a, curve in found.items() if curve is not None}

    def _status(self) -> str:
        if problem := self._problem or self.panel.problem:
            return problem
        ready = self._shown.ready()
        seconds = (
            f"{self.timeline.time_s:.2f} s of {self.timeline.frames / self.timeline.fps:.2f} s"
        )
        return seconds if ready == 1.0 else f"{seconds}; computing, {ready:.0%} done"
