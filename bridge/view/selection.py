"""What a viewer was asked to show, and what it draws for that in one frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.runtime.controls import Floor
from bridge.view.performances import AS_PREDICTED, Asked, Gains, Performances, Way
from bridge.view.repertoire import LABELS, TRUTH

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
    shown: tuple[str, ...]
    """Predictors, `smpl`, `truth`: who stands there, from left to right."""
    gains: Gains = AS_PREDICTED
    floor: Floor = "keep"
    loop: bool = False
    layout: str = SIDE_BY_SIDE
    colouring: str = OFFSETS
    full_cm: float = 2.0
    """What has the last colour."""
    in_place: bool = False
    """Whether the root's way over the ground is left out."""
    shadows: bool = True
    """Whether bodies cast them: most of the cost of drawing without a graphics card."""

    @property
    def way(self) -> Way:
        """How somebody moves."""
        return Way(self.take, self.betas, self.floor, self.loop)


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
    """A selection with the performances that it needs under way; the truth only where known."""

    def __init__(self, performances: Performances, selection: Selection) -> None:
        self.performances, self.selection = performances, selection
        self.knows_truth = performances.knows_truth(selection.way)
        names = [name for name in selection.shown if self.knows_truth or name != TRUTH]
        self.asked = [Asked(selection.way, name) for name in names]
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
        selection, performances = self.selection, self.performances
        labels = {**LABELS, **performances.repertoire.predictors}
        one, true = slice(frame, frame + 1), Asked(selection.way, TRUTH)
        true_clip = performances.clip(true) if self.knows_truth else None
        root_m = np.zeros(3, np.float32)
        if selection.in_place:
            way_m = performances.motion(selection.way).theta[frame, -3:] * [1, 0, 1]
            root_m = way_m.astype(np.float32)
        for asked in self.asked:
            clip, label = performances.clip(asked), labels[asked.predictor]
            assert clip is not None
            vertices_m = performances.vertices_m(asked, one, selection.gains)[0]
            values_m = None
            if selection.colouring == OFFSETS:
                gain = performances.gain(asked, selection.gains)
                values_m = np.linalg.norm(gain * clip.offsets_m[frame], axis=-1)
            elif selection.colouring == ERRORS and true_clip is not None and true_clip.complete:
                gap_m = vertices_m - performances.vertices_m(true, one)[0]
                values_m = np.linalg.norm(gap_m, axis=-1)
            if failure := performances.worker.failed.get(asked):
                label = f"{label}: {failure}"
            elif frame >= clip.ready:
                share = 100 * clip.ready // len(clip.offsets_m)
                label = f"{label}: {share} % computed; SMPL alone until then"
            yield Posed(asked.predictor, label, vertices_m - root_m, values_m)
