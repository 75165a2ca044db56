"""What a rival is: settings chosen on clips, and offsets for a motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class MotionClip:
    """One motion of one person, with the aligned offsets that settings are chosen by."""

    betas: NDArray
    """(10,) shape."""
    theta: NDArray
    """(T, 69) pose and translation."""
    fps: float
    """Frames per second."""
    offsets_m: NDArray
    """(T, V, 3) aligned offsets in the rest pose, metres."""


class Rival(Protocol):
    """A system that moves a body's skin."""

    name: str
    label: str

    def choose(self, clips: Sequence[MotionClip]) -> list[str]:
        """Choose the settings that fit the clips best; what was chosen, a clause each."""
        ...

    def offsets_m(self, betas: NDArray, theta: NDArray, fps: float) -> NDArray:
        """(T, V, 3) what the rival adds to the skinned mesh, in the rest pose, metres."""
        ...
