"""A character in motion: skin offsets and posed vertices, some frames at a time.

What prediction, export and the viewer have in common; memory does not grow with the motion.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body.smpl import Smpl
from bridge.errors import DsnetError, notify
from bridge.motion import Motion, unpack_theta
from bridge.motion.cuts import pieces_between_cuts
from bridge.motion.motion_checks import motion_warnings
from bridge.runs.workers import progress
from bridge.runtime.characters import Character
from bridge.runtime.stepping import Prediction


@dataclass(frozen=True, eq=False)
class MovedFrames:
    """T' frames that follow one another."""

    frames: slice
    """Which of the motion's."""
    offsets_m: NDArray[np.float32]
    """(T', V, 3) in the rest pose, metres."""
    vertices_m: NDArray[np.float32]
    """(T', V, 3) in the world, metres, y up."""

    def __len__(self) -> int:
        return len(self.offsets_m)


class MovingBody:
    """A character that performs a motion; iterating gives `MovedFrames` from first to last.

    The body begins from rest, settled in its first pose, there and after every cut.

    Parameters
    ----------
    character : who moves.
    motion : (T, 69) at 60 frames a second with y up, and the shape to move with.
    gain : by which the predicted offsets are multiplied, one number or one a vertex (V,): 0 is
        SMPL alone, 1 what was predicted.
    controls : all that an animator asked for, by name: `Controls.given()`, which motion, character
        and gain already obey. It goes with what is written of the body.
    """

    def __init__(
        self,
        character: Character,
        motion: Motion,
        gain: float | NDArray[np.floating] = 1.0,
        controls: Mapping[str, Any] | None = None,
    ) -> None:
        self.character, self.motion = character, motion
        self.controls = dict(controls or {})
        self.pieces = pieces_between_cuts(motion.theta)
        self._gain = np.asarray(gain, np.float32)
        self._gain = self._gain[:, None] if self._gain.ndim else self._gain

    def __len__(self) -> int:
        return len(self.motion.theta)

    @property
    def latents(self) -> NDArray[np.float32] | None:
        """(T, 100) codes that the offsets are decoded from, before any gain, if there are any."""
        found = [prediction.latents for prediction in self._predictions()]
        latents = [part for part in found if part is not None]
        return np.concatenate(latents) if latents else None

    def _predictions(self) -> list[Prediction]:
        """Of each piece between cuts; their offsets are computed when they are asked for."""
        betas = self.motion.betas
        return [self.character.predict(self.motion.theta[piece], betas) for piece in self.pieces]

    def __iter__(self) -> Iterator[MovedFrames]:
        pose, trans = unpack_theta(self.motion.theta)
        shaped, start = Smpl(self.character.body).person(self.motion.betas), 0
        for found_m in chain.from_iterable(found.offsets_m for found in self._predictions()):
            frames = slice(start, start + len(found_m))
            offsets_m = found_m * self._gain
            vertices_m = shaped.pose(pose[frames], trans[frames], offsets_m)
            if not np.isfinite(vertices_m).all():
                raise DsnetError(
                    f"{self.motion.source}, whose vertices are not finite from frame {start} on",
                    "a predictor that gives finite offsets",
                    "Train the run again, or pass another --run.",
                )
            yield MovedFrames(frames, offsets_m, vertices_m)
            start = frames.stop

    def shown(self, what: str) -> Iterator[MovedFrames]:
        """The same frames; a terminal is told how far `what` is."""
        with progress(what=what, unit="frame", total=len(self)) as bar:
            for posed in self:
                yield posed
                bar.update(len(posed))


def announce(moving: MovingBody) -> None:
    """Say on stderr which predictor moves the body, and what is odd about the motion."""
    chosen, motion = moving.character.chosen, moving.motion
    notify(f"{chosen.name} ({chosen.label}) of {chosen.owner} predicts: {chosen.why}")
    for warning in motion_warnings(motion, moving.pieces):
        notify(warning)
