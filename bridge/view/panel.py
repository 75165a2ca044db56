"""The controls: motion and person, who is shown and how, shape, gain, time."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, get_args

import numpy as np
import viser

from bridge.body.parts import PARTS
from bridge.body.shapes import SHAPES
from bridge.errors import DsnetError
from bridge.paper import N_BETAS
from bridge.runtime.controls import Floor
from bridge.view.performances import Gains, Performances
from bridge.view.repertoire import AS_ASKED, LABELS, SMPL_ALONE, TRUTH
from bridge.view.selection import COLOURINGS, LAYOUTS, Selection

_SPEEDS = {"0.1": 0.1, "0.25": 0.25, "0.5": 0.5, "1": 1.0, "2": 2.0}
_OWN_PERSON = "who moved"
_MOST_BETA, _MOST_GAIN = 5.0, 5.0


@dataclass
class Timeline:
    """A clock over the frames of one motion, which begins again at its end."""

    frames: int
    fps: float = 60.0
    speed: float = 1.0
    """1 is as fast as the motion is."""
    playing: bool = True
    _at: float = 0.0
    _lock: threading.Lock = field(default_factory=threading.Lock)
    """A hand moves it in another thread than the clock."""

    @property
    def frame(self) -> int:
        """To be seen now."""
        return min(int(self._at), self.frames - 1)

    @property
    def time_s(self) -> float:
        """Of its frame in the motion."""
        return self.frame / self.fps

    def pass_time(self, seconds: float) -> int:
        """Let time pass, and say which frame is to be seen then."""
        with self._lock:
            if self.playing:
                self._at = (self._at + seconds * self.speed * self.fps) % self.frames
            return self.frame

    def go_to(self, frame: int) -> None:
        """Jump to a frame; beyond the ends, to the first or last."""
        with self._lock:
            self._at = float(min(max(frame, 0), self.frames - 1))

    def stop_at(self, frame: int) -> None:
        """Pause at a frame."""
        self.playing = False
        self.go_to(frame)

    def begin(self, frames: int, fps: float, frame: int = 0) -> None:
        """Take another motion, or the same with more frames or fewer, from a frame on."""
        self.frames, self.fps = frames, fps
        self.go_to(frame)


class Panel:
    """Controls of one viewer; what they say now is `selection`, and time is in `timeline`.

    `record` makes the recording of a selection, HTML, for the button.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        performances: Performances,
        start: Selection,
        timeline: Timeline,
        record: Callable[[Selection], str],
    ) -> None:
        self._performances, self._timeline = performances, timeline
        self._record, self._own, self.problem = record, start.betas, ""
        gui, repertoire = server.gui, performances.repertoire
        gui.set_panel_label(f"dsnet view · {repertoire.origin}")
        gui.main_panel.dock_right()
        gui.configure_theme(show_share_button=False, show_logo=False)
        gui.add_markdown(f"Predictors of {repertoire.owner}; **{repertoire.origin}** data.")
        self._status = gui.add_markdown("")
        self._add_time(gui)
        with gui.add_folder("Motion and person"):
            self._take = gui.add_dropdown(
                "Motion", tuple(repertoire.takes), initial_value=start.take
            )
            people = (_OWN_PERSON, *repertoire.people, *SHAPES)
            asked = AS_ASKED if AS_ASKED in people else _OWN_PERSON
            self._person = gui.add_dropdown("Person", people, initial_value=asked)
            self._floor = gui.add_dropdown("Floor", get_args(Floor), initial_value=start.floor)
            self._loop = gui.add_checkbox("Loop", start.loop)
        with gui.add_folder("Shown"):
            labels = {SMPL_ALONE: LABELS[SMPL_ALONE]} | dict(repertoire.predictors)
            if repertoire.read_truth is not None:
                labels[TRUTH] = LABELS[TRUTH]
            self._shown = {
                name: gui.add_checkbox(label, name in start.shown) for name, label in labels.items()
            }
            self._layout = gui.add_dropdown("Layout", LAYOUTS, initial_value=start.layout)
            self._colouring = gui.add_dropdown("Colours", COLOURINGS, initial_value=start.colouring)
            self._full_cm = gui.add_slider("Last colour, cm", 0.1, 10.0, 0.1, start.full_cm)
            self._in_place = gui.add_checkbox("Stay in place", start.in_place)
            self._shadows = gui.add_checkbox("Shadows", start.shadows)
        with gui.add_folder("Dynamics"):
            gain = start.gains.of_all
            self._gain = gui.add_slider("Gain", 0.0, max(_MOST_GAIN, gain), 0.05, gain)
            with gui.add_folder("Gain by part", expand_by_default=False):
                names = [part.replace("_", " ") for part in PARTS]
                self._part_gains = [
                    gui.add_slider(name, 0.0, max(_MOST_GAIN, gain), 0.05, gain)
                    for name, gain in zip(names, start.gains.of_parts, strict=True)
                ]
        with gui.add_folder("Betas", expand_by_default=False):
            self._betas = [
                gui.add_slider(f"Beta {number + 1}", -_MOST_BETA, _MOST_BETA, 0.05, 0.0)
                for number in range(N_BETAS)
            ]
            gui.add_button("Shape of the person").on_click(self._on_person)
        self._add_recording(gui)
        self._set_betas(start.betas)
        self._take.on_update(self._on_person)
        self._person.on_update(self._on_person)

    def _add_time(self, gui: viser.GuiApi) -> None:
        self._told: int | None = 0
        """The frame that pages show, if they do not lag."""
        with gui.add_folder("Time"):
            self._frame = gui.add_slider("Frame", 0, max(self._timeline.frames - 1, 1), 1, 0)
            self._play = gui.add_button("Pause", icon=viser.Icon.PLAYER_PAUSE)
            self._speed = gui.add_dropdown("Speed", tuple(_SPEEDS), initial_value="1")
        self._frame.on_update(self._on_scrub)
        self._play.on_click(self._on_play)
        self._speed.on_update(self._on_speed)

    def _add_recording(self, gui: viser.GuiApi) -> None:
        button = gui.add_button("Recording (HTML)", icon=viser.Icon.DOWNLOAD)

        @button.on_click
        def _(event: viser.GuiEvent[Any]) -> None:
            button.disabled, self.problem = True, ""
            try:
                html = self._record(self.selection)
                if event.client is not None:
                    event.client.send_file_download("dsnet.html", html.encode())
            except DsnetError as error:
                self.problem = str(error)
            finally:
                button.disabled = False

    async def _on_scrub(self, event: viser.GuiEvent[Any]) -> None:
        # As a coroutine it reads the hand's value before the clock can write over it.
        if event.client is not None:  # a hand, not the clock
            self._timeline.stop_at(self._frame.value)
            self._told = None

    def _on_play(self, _: viser.GuiEvent[Any]) -> None:
        self._timeline.playing = not self._timeline.playing

    def _on_speed(self, _: viser.GuiEvent[Any]) -> None:
        self._timeline.speed = _SPEEDS[self._speed.value]

    def _on_person(self, _: viser.GuiEvent[Any]) -> None:
        performances, name, self.problem = self._performances, self._person.value, ""
        if name == _OWN_PERSON:
            self._set_betas(performances.own_betas(self._take.value))
            return
        try:
            self._set_betas(performances.person_betas(name))
        except DsnetError as error:
            self.problem = str(error)

    def _set_betas(self, betas: tuple[float, ...]) -> None:
        """Set the sliders to a person's shape, which lies between their steps."""
        self._own = betas
        for slider, value in zip(self._betas, betas, strict=True):
            slider.value = float(np.clip(round(value, 2), -_MOST_BETA, _MOST_BETA))
        self._rounded = tuple(slider.value for slider in self._betas)

    @property
    def selection(self) -> Selection:
        """What is chosen now."""
        betas = tuple(slider.value for slider in self._betas)
        return Selection(
            take=self._take.value,
            betas=self._own if betas == self._rounded else betas,
            shown=tuple(name for name, box in self._shown.items() if box.value),
            gains=Gains(self._gain.value, tuple(slider.value for slider in self._part_gains)),
            floor=self._floor.value,
            loop=self._loop.value,
            layout=self._layout.value,
            colouring=self._colouring.value,
            full_cm=self._full_cm.value,
            in_place=self._in_place.value,
            shadows=self._shadows.value,
        )

    def begin(self, frames: int) -> None:
        """Take the length of another motion."""
        self._frame.max = max(frames - 1, 1)

    def tell(self, frame: int, status: str) -> None:
        """Show the present frame, and one line of what is going on."""
        playing = self._timeline.playing
        if frame != self._told:
            if frame == self._frame.value:
                # A hand's own value is not sent, but frames on their way to the page come after it.
                self._frame.value = frame + 1 if frame == 0 else frame - 1
            self._frame.value = self._told = frame
        self._play.label = "Pause" if playing else "Play"
        self._play.icon = viser.Icon.PLAYER_PAUSE if playing else viser.Icon.PLAYER_PLAY
        if status != self._status.content:
            self._status.content = status
