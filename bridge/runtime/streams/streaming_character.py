"""One character of a stream: what it was given, what came of it, and what it owes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bridge.body.smpl import ShapedBody
from bridge.motion.cuts import is_cut
from bridge.motion.resampling import between, going_on
from bridge.runtime.stepping import Model, finished
from bridge.runtime.streams.frame_clock import FrameClock


@dataclass(frozen=True, eq=False)
class StreamedCharacter:
    """All that one's future depends on; replaced, never changed, so that a refused step is none."""

    shaped: ShapedBody
    betas: NDArray
    """(10,)."""
    frames: int = 0
    """That she was given."""
    poses: tuple[NDArray, ...] = ()
    """The newest of them, (69,) each."""
    since_cut: int = 0
    """How many frames."""
    state: NDArray[np.float32] | None = None
    """(S,) the model's, after the newest tick."""
    since_begin: int = 0
    """How many ticks that state has seen."""
    first: int = 0
    """Number of the first tick that is kept."""
    ticks: tuple[NDArray, ...] = ()
    """Poses (69,) from that tick on."""
    begins: tuple[bool, ...] = ()
    """Whether the tissue begins there, at rest."""
    codes: tuple[NDArray, ...] = ()
    """What the model made of them; of the newest it may not be known yet."""

    def code_at(self, frame: int, clock: FrameClock) -> NDArray:
        """Of a frame, between those of the ticks about it, but not across a cut."""
        tick, share = clock.place(frame)
        row = tick - self.first
        here, there = self.codes[row], self.codes[row + 1 : row + 2]
        if not (share and there):
            return here
        if not self.begins[row + 1]:
            return here + np.float32(share) * (there[0] - here)
        pose = self.pose_at(frame)
        return here if is_cut(pose[None], self.ticks[row + 1][None])[0] else there[0]

    def pose_at(self, frame: int) -> NDArray:
        """(69,) one of the newest."""
        return self.poses[frame - self.frames]

    def finished(self, model: Model) -> StreamedCharacter:
        """With all codes, for she stops here."""
        if self.state is None:
            return self
        owed = finished(model, self.state[None], self.ticks[-1][None])
        # Of a motion shorter than the look-ahead the first are those before its beginning.
        owed = owed[max(model.look_ahead - self.since_begin + 1, 0) :]
        return replace(self, codes=(*self.codes, *(codes[0] for codes in owed)))

    def begun(self, model: Model, theta: NDArray) -> StreamedCharacter:
        """At rest in the next tick's pose theta (69,), which is still to be stepped."""
        state = model.reset(self.betas[None], theta[None])[0]
        return replace(self.finished(model), state=state, since_begin=0)

    def stepped(
        self, theta: NDArray, state: NDArray, code: NDArray, look_ahead: int
    ) -> StreamedCharacter:
        """With one tick more, in the pose theta (69,), and what the model made of it."""
        # The first tick's code comes again until another's is known.
        known = (code,) if not 0 < self.since_begin <= look_ahead else ()
        return replace(
            self,
            state=state,
            since_begin=self.since_begin + 1,
            ticks=(*self.ticks, theta),
            begins=(*self.begins, self.since_begin == 0),
            codes=(*self.codes, *known),
        )

    def without(self, frame: int, clock: FrameClock) -> StreamedCharacter:
        """Only with what frames from this one on need, and what tells a cut to the next."""
        tick, _ = clock.place(frame)
        old = min(tick - self.first, len(self.ticks) - 1)
        return replace(
            self,
            poses=self.poses[min(frame - self.frames, -2) :],
            first=self.first + old,
            ticks=self.ticks[old:],
            begins=self.begins[old:],
            codes=self.codes[old:],
        )


def advanced(
    characters: Sequence[StreamedCharacter],
    theta: NDArray,
    clock: FrameClock,
    model: Model,
) -> list[StreamedCharacter]:
    """Each given one frame more, of theta (B, 69), and all ticks up to it."""
    found = list(characters)
    before = np.array(
        [c.poses[-1] if c.poses else row for c, row in zip(found, theta, strict=True)]
    )
    cut = is_cut(before, theta)
    # Ticks before a cut's frame are still the old motion's, which goes on as it did.
    towards = np.array([
        going_on(c.poses[-min(c.since_cut, 2)], c.poses[-1]) if jumps else row
        for c, row, jumps in zip(found, theta, cut, strict=True)
    ])  # fmt: skip
    ticks = [clock.ticks(c.frames) for c in found]
    for turn in range(max(map(len, ticks))):
        rows = [row for row, numbers in enumerate(ticks) if turn < len(numbers)]
        share = np.array([clock.share(ticks[row][turn], found[row].frames) for row in rows])
        after = np.where(share[:, None] == 1, theta[rows], towards[rows])
        given = _ticked([found[row] for row in rows], between(before[rows], after, share), model)
        for row, character in zip(rows, given, strict=True):
            found[row] = character
    return [
        replace(
            c,
            frames=c.frames + 1,
            poses=(*c.poses, pose),
            since_cut=1 if jumps else c.since_cut + 1,
        )
        for c, pose, jumps in zip(found, theta, cut, strict=True)
    ]


def _ticked(
    characters: Sequence[StreamedCharacter], theta: NDArray, model: Model
) -> list[StreamedCharacter]:
    """Each given one tick more, of theta (B, 69); after a cut its tissue begins anew."""
    before = np.array(
        [c.ticks[-1] if c.ticks else row for c, row in zip(characters, theta, strict=True)]
    )
    jumps = is_cut(before, theta)
    here = [
        c.begun(model, row) if c.state is None or jump else c
        for c, row, jump in zip(characters, theta, jumps, strict=True)
    ]
    states, codes = model.step(np.stack([c.state for c in here if c.state is not None]), theta)
    return [
        c.stepped(row, state.copy(), code.copy(), model.look_ahead)
        for c, row, state, code in zip(here, theta, states, codes, strict=True)
    ]
