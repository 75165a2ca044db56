"""One predictor, one step. Whole motions, streams, the viewer and exports are loops over it.

    state = model.reset(betas, theta0)           # characters who have stood in theta0 for ever
    state, codes = model.step(state, theta)      # one frame, 1/60 s, of all of them
    offsets_m = model.offsets_m(betas, codes, theta)

The first step is given theta0 again. Codes of a step are those of `look_ahead` frames ago, of the
first frame until then; they may be mixed linearly. A motion ends by standing still in its last
pose, without a jolt: `model.stopped(state)` and that pose `look_ahead` times more.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

FRAMES_AT_ONCE = 64
"""Frames in a piece of offsets: what is held in memory at a time."""
State = NDArray[np.float32]
"""(B, S): a row is all that is known of a character. Rows may be taken, stacked and reordered from
frame to frame; what is made of one is independent of the others, and none is ever changed."""
Codes = NDArray[np.float32]
"""(B, ...)."""


class Model(Protocol):
    """A trained predictor on a body."""

    look_ahead: int
    """Frames after which a frame's codes are known."""
    codes_are_latents: bool

    def reset(self, betas: NDArray, theta0: NDArray) -> State:
        """Characters (B, 10) who are at rest in the poses theta0 (B, 69)."""
        ...

    def step(self, state: State, theta: NDArray) -> tuple[State, Codes]:
        """The state one frame later, in the poses theta (B, 69), and codes."""
        ...

    def stopped(self, state: State) -> State:
        """The same characters, who will not have moved when they take their newest pose again."""
        ...

    def offsets_m(self, betas: NDArray, codes: Codes, theta: NDArray) -> NDArray[np.float32]:
        """(N, V, 3) skin offsets in the rest pose, metres, of codes (N, ...) in the poses theta
        (N, 69), of characters betas (N, 10) or frames of one (10,)."""
        ...


@dataclass(frozen=True, eq=False)
class Prediction:
    """What a predictor says of one motion of T frames."""

    offsets_m: Iterator[NDArray[np.float32]]
    """Skin offsets in the rest pose, metres: pieces (T', V, 3) that follow one another."""
    latents: NDArray[np.float32] | None = None
    """(T, 100) codes that the offsets are decoded from, if they are."""


class MotionPredictor(Protocol):
    """Predicts whole motions of one body."""

    def __call__(self, theta: NDArray, betas: NDArray) -> Prediction:
        """Predict a motion theta (T, 69) at 60 frames a second without a cut, of a body (10,).

        The body begins from rest, settled in its first pose.
        """
        ...


@dataclass(frozen=True, eq=False)
class WholeMotions:
    """A model, stepped through one motion after another."""

    model: Model

    def __call__(self, theta: NDArray, betas: NDArray) -> Prediction:
        """As `MotionPredictor` says."""
        codes = codes_of(self.model, theta, betas)
        if not self.model.codes_are_latents:
            return Prediction(self._offsets_m(codes, theta, betas))
        latents = np.stack([*codes])
        return Prediction(self._offsets_m(iter(latents), theta, betas), latents)

    def _offsets_m(
        self, codes: Iterator[NDArray], theta: NDArray, betas: NDArray
    ) -> Iterator[NDArray[np.float32]]:
        for start in range(0, len(theta), FRAMES_AT_ONCE):
            piece = theta[start : start + FRAMES_AT_ONCE]
            found = np.stack([*islice(codes, len(piece))])
            yield self.model.offsets_m(betas, found, piece)


def codes_of(model: Model, theta: NDArray, betas: NDArray) -> Iterator[NDArray[np.float32]]:
    """The code of each frame of a motion theta (T, 69) of a body (10,)."""
    return (codes[0] for _, codes in codes_of_several(model, [theta], betas[None]))


def codes_of_several(
    model: Model, motions: Sequence[NDArray], betas: NDArray
) -> Iterator[tuple[NDArray[np.intp], Codes]]:
    """For one frame after another, which of some motions (T, 69) of bodies betas (B, 10) have it,
    and their codes."""
    lengths = np.array([len(theta) for theta in motions])
    here = np.arange(len(motions))
    state = model.reset(betas, np.stack([theta[0] for theta in motions]))
    for frame in range(int(lengths.max()) + model.look_ahead):
        left = lengths[here] - frame
        if left.min() <= -model.look_ahead:
            goes_on = left > -model.look_ahead
            here, state, left = here[goes_on], state[goes_on], left[goes_on]
        if not left.all():
            state = np.where(left[:, None] == 0, model.stopped(state), state)
        poses = [motions[row][min(frame, len(motions[row]) - 1)] for row in here.tolist()]
        state, codes = model.step(state, np.stack(poses))
        if frame >= model.look_ahead:
            yield here, codes


def finished(model: Model, state: State, theta: NDArray) -> list[Codes]:
    """The codes still to come if motions end in their newest poses theta (B, 69)."""
    state, owed = model.stopped(state), []
    for _ in range(model.look_ahead):
        state, codes = model.step(state, theta)
        owed.append(codes)
    return owed
