"""Which frame is to be seen when: play, pause, scrub and speed."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field


@dataclass
class Timeline:
    """A clock over the frames of one motion, which begins again at its end."""

    frames: int
    """How many there are."""
    fps: float = 60.0
    """The motion's frames a second at speed 1."""
    speed: float = 1.0
    """1 is as fast as the motion is."""
    playing: bool = True
    """Whether time passes."""
    _at: float = 0.0
    _lock: threading.Lock = field(default_factory=threading.Lock)
    """A hand moves it in another thread than the clock."""

    @property
    def frame(self) -> int:
        """The frame to be seen now."""
        return min(int(self._at), self.frames - 1)

    @property
    def time_s(self) -> float:
        """Its time in the motion, seconds."""
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

    def take_length(self, frames: int) -> None:
        """Go on where it is in the same motion with more frames or fewer."""
        self.frames = frames
        self.go_to(self.frame)

    def begin(self, frames: int, fps: float) -> None:
        """Take another motion, from its first frame on."""
        self.frames, self.fps, self._at = frames, fps, 0.0
