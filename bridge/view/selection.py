"""What a viewer was asked to show, and what it draws for that in one frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.runtime.controls import Floor
from bridge.view.clips import AS_PREDICTED, LABELS, Asked, Gains, Way
from bridge.view.performances import Performances
from bridge.view.truth import TRUTH

SIDE_BY_SIDE, OVERLAID = "side by side", "overlaid"
LAYOUTS = (SIDE_BY_SIDE, OVERLAID)
OFFSETS, ERRORS, PLAIN = "size of offset", "distance to truth", "none"
COLOURINGS = (OFFSETS, ERRORS, PLAIN)


@dataclass(frozen=True)
class Selection:
    """Everything that can be chosen but the time."""

    take: str
    """Which motion."""
    betas: tuple[float, ...]
    """Ten shape coefficients."""
    shown: tuple[str, ...]
    """Predictors, `smpl`, `truth`: who stands there, from left to right."""
    gains: Gains = AS_PREDICTED
    """Of predicted offsets."""
    floor: Floor = "keep"
    """Where the motion stands."""
    loop: bool = False
    """Whether the motion repeats."""
    layout: str = SIDE_BY_SIDE
    """One of `LAYOUTS`."""
    colouring: str = OFFSETS
    """One of `COLOURINGS`."""
    full_cm: float = 2.0
    """What has the last colour, centimetres."""
    in_place: bool = False
    """Whether the root's way over the ground is left out."""
    shadows: bool = True
    """Whether bodies cast them: most of the cost of drawing without a graphics card."""

    @property
    def way(self) -> Way:
        """How somebody moves."""
        return Way(self.take, self.betas, self.floor, self.loop)

    def asked(self, known: bool) -> list[Asked]:
        """Keys of the performances that it needs; the truth only where it is known."""
        return [Asked(self.way, name) for name in self.shown if known or name != TRUTH]


@dataclass(frozen=True, eq=False)
class Posed:
    """One body in one frame."""

    name: str
    """Predictor, `smpl` or `truth`."""
    label: str
    """What stands over it."""
    vertices_m: NDArray[np.float32]
    """(V, 3) about its own place, metres."""
    values_m: NDArray[np.float32] | None
    """(V,) what its colours show, metres; None for no colours."""


class Shown:
    """A selection with the performances that it needs under way.

    Raises
    ------
    DsnetError
        If a motion or a predictor cannot be read.
    """

    def __init__(self, performances: Performances, selection: Selection) -> None:
        self.performances, self.selection = performances, selection
        self.knows_truth = performances.knows_truth(selection.way)
        self.asked = selection.asked(self.knows_truth)
        performances.want(self.asked, selection.gains)

    @property
    def frames(self) -> int:
        """How many there are to be seen."""
        return len(self.performances.motion(self.selection.way).theta)

    def ready(self) -> float:
        """The part of all frames that has been computed, 0 to 1."""
        clips = [clip for asked in self.asked if (clip := self.performances.clip(asked))]
        return sum(c.ready for c in clips) / max(sum(len(c.offsets_m) for c in clips), 1)

    def posed(self, frame: int) -> Iterator[Posed]:
        """Every body in one frame; those that are not computed yet as SMPL alone, and say so."""
        selection = self.selection
        true = Asked(selection.way, TRUTH)
        root_m = self._root_m(frame)
        for asked in self.asked:
            one = slice(frame, frame + 1)
            vertices_m = self.performances.vertices_m(asked, one, selection.gains)[0]
            values_m = None
            if selection.colouring == OFFSETS:
                values_m = self._size_m(asked, frame)
            elif selection.colouring == ERRORS and self._computed(true):
                gap_m = vertices_m - self.performances.vertices_m(true, one)[0]
                values_m = np.linalg.norm(gap_m, axis=-1)
            yield Posed(asked.predictor, self._label(asked, frame), vertices_m - root_m, values_m)

    def _computed(self, asked: Asked) -> bool:
        clip = self.performances.clip(asked)
        return self.knows_truth and clip is not None and clip.complete

    def _root_m(self, frame: int) -> NDArray[np.float32]:
        """(3,) the way over the ground that is left out."""
        motion = self.performances.motion(self.selection.way)
        way_m = motion.theta[frame, -3:] * [1, 0, 1]
        return (way_m if self.selection.in_place else np.zeros(3)).astype(np.float32)

    def _size_m(self, asked: Asked, frame: int) -> NDArray[np.float32]:
        clip = self.performances.clip(asked)
        assert clip is not None
        gain = self.performances.gain(asked, self.selection.gains)
        return np.linalg.norm(gain * clip.offsets_m[frame], axis=-1)

    def _label(self, asked: Asked, frame: int) -> str:
        labels = {**LABELS, **self.performances.repertoire.predictors}
        label, clip = labels[asked.predictor], self.performances.clip(asked)
        if failure := self.performances.worker.failed.get(asked):
            return f"{label}: {failure}"
        if clip is not None and frame >= clip.ready:
            share = 100 * clip.ready // len(clip.offsets_m)
            return f"{label}: {share} % computed; SMPL alone until then"
        return label
