"""Streaming: characters that join, move frame by frame at any frame rate, and leave.

stream = dsnet.Stream(fps=90)  # or with the predictor of a run: dsnet.Stream("demo")
anna = stream.join(betas)
moved = stream.step({anna: theta})[anna]  # .vertices_m, .offsets_m
stream.leave(anna)
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.body import BodyModelData
from bridge.body.embedded import EMBEDDED_GENDERS
from bridge.body.model_data import GENDERS
from bridge.body.posing import ShapedBody, Smpl
from bridge.errors import DsnetError
from bridge.motion import Motion, unpack_theta
from bridge.motion.cuts import is_cut
from bridge.motion.interpolation import between, going_on
from bridge.motion.smoothing import StreamSmoother
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.prediction.load_model import Source, find_model, load_model, requested_body
from dsnet.prediction.models import Model, PlusModel, finished
from dsnet.prediction.moving_body import place_motion
from dsnet.prediction.shape_space import with_betas_on
from dsnet.stream.frame_clock import FrameClock
from dsnet.stream.stream_checks import PoseWarnings, checked_betas, checked_pose

_ALL_BETAS = 1000
"""More shape coefficients than any body file has: all are kept."""


@dataclass(frozen=True, eq=False)
class MovedBody:
    """One body at one frame."""

    vertices_m: NDArray[np.float32]
    """(V, 3) in the world."""
    offsets_m: NDArray[np.float32]
    """(V, 3) in the rest pose, for an engine that does the skinning."""
    latents: NDArray[np.float32] | None = None
    """(100,) from which the offsets are decoded; None if the predictor has no latents."""


class Stream:
    """Skin offsets and posed vertices of any number of characters, frame by frame.

    Characters are independent of one another (vertices within a micrometre, as matrix products of
    several round differently). The results are those of the whole motion (offsets within 1e-5 m),
    as both are loops over `Model.step`. A character starts in static equilibrium in its first pose,
    and again after a cut (`bridge.motion.cuts`). Cuts at each of ten frames, and many repeated
    poses, are warned about on stderr.

    The model computes 60 ticks a second. At another rate poses are interpolated linearly to ticks,
    as `load_motion` does for files of 60 and more frames a second (for slower files it uses
    splines, which look ahead), and results are interpolated from ticks to frames. Results are
    `latency_frames` late: the model looks some ticks ahead, and a frame needs the ticks before and
    after it.

    The memory for a character does not grow with time.

    Parameters
    ----------
    model : as for `load_model`: None for the small model that comes with the package, the name of a
        run, a folder that `TrainedModel.save` wrote, or what `load_model` returned; or a
        `TrainedPlus`, then with its `body`.
    predictor : name of a predictor of the run; the run's best when None.
    body : the body model that moves, or its file or folder; when None `DSNET_BODY`, or else the
        run's.
    gender : of the packaged model's body, and of a folder's: `female`, `male` or `neutral`.
    fps : frames per second of poses and results, 10 to 1000.
    smooth : remove the noise of a recording (`bridge.motion.smoothing`); adds three frames of
        latency.
    """

    def __init__(
        self,
        model: Source | TrainedPlus = None,
        predictor: str | None = None,
        *,
        body: BodyModelData | Path | str | None = None,
        gender: str = "female",
        fps: float = 60.0,
        smooth: bool = False,
    ) -> None:
        self._clock, self._smooth = FrameClock(fps), smooth
        if gender not in GENDERS:
            raise DsnetError(f"gender={gender!r}", " or ".join(GENDERS), "Pass one of these.")
        if isinstance(model, TrainedPlus):
            if not isinstance(body, BodyModelData):
                raise DsnetError("a model without a body", "the body it moves", "Pass body=.")
            self._model: Model = PlusModel(model, body)
        else:
            if isinstance(body, BodyModelData):
                gender = body.gender if body.gender in EMBEDDED_GENDERS else gender
                self._model = find_model(model, predictor, gender).open(body)
            else:
                trained = load_model(
                    model, predictor, gender, requested_body(body), more_betas=_ALL_BETAS
                )
                self._model, body = trained.model, trained.body
        self._body, self._skin = body, Smpl(body, hands=False)
        self._characters: dict[int, _Character] = {}
        self._numbers = count()
        self._latency = self._clock.latency_frames(self._model.look_ahead)
        self.latency_frames = self._latency + (StreamSmoother.look_ahead if smooth else 0)
        """Age of the results of `step`, frames."""
        self.latency_s = self.latency_frames / self._clock.fps
        """Age of the results of `step`, seconds."""

    @property
    def characters(self) -> tuple[int, ...]:
        """Numbers of the present characters, in the order in which they joined."""
        return tuple(self._characters)

    def placed(self, motion: Motion) -> Motion:
        """Adapt a motion, as read from its file, to the stream's body.

        Pass the result's `betas` to `join`, and its `theta`, y up and about this body's root joint,
        to `step`.
        """
        return place_motion(with_betas_on(motion, self._body), self._body)

    def join(self, betas: ArrayLike) -> int:
        """Add a character with betas (10,), or more if the body has more; gives its number.

        Numbers are not used again. This and the character's first step take longer than later
        steps, as the static equilibrium is computed.
        """
        shape = checked_betas(betas, self._body)
        smoother = StreamSmoother(self._clock.fps) if self._smooth else None
        character = _Character(self._skin.person(shape), shape, smoother)
        number = next(self._numbers)
        self._characters[number] = character
        return number

    def step(self, poses: Mapping[int, ArrayLike]) -> dict[int, MovedBody]:
        """Advance the given characters by one frame of 1 / fps s; for others no time passes.

        `poses` are theta (69,) by the numbers that `join` gave. The result has, by the same
        numbers, each character as it was `latency_frames` ago, or at its first frame if it joined
        later than that. Raises DsnetError if there is no such character, or a pose has another
        shape, numbers that are not finite, or impossible ones. Nothing has moved then: go on with
        the next frame.
        """
        characters = [self._character(number) for number in poses]
        if not characters:
            return {}
        rows = [checked_pose(f"theta of character {n}", theta) for n, theta in poses.items()]
        for character, row in zip(characters, rows, strict=True):
            character.warnings.check_repeats(row, self._clock.fps)
        smooth = [
            c.smoother.push(row) if c.smoother else row
            for c, row in zip(characters, rows, strict=True)
        ]
        ready = [(c, row) for c, row in zip(characters, smooth, strict=True) if row is not None]
        if ready:
            self._advance([c for c, _ in ready], np.stack([row for _, row in ready]))
        moved = self._moved(characters, [max(c.frames - 1 - self._latency, 0) for c in characters])
        for character in characters:
            character.forget(max(character.frames - self._latency, 0), self._clock)
        return dict(zip(poses, moved, strict=True))

    def leave(self, who: int) -> Iterator[MovedBody]:
        """Remove a character; gives its last `latency_frames` frames, which no step has returned.

        They are computed lazily, as if the motion ended there.
        """
        character = self._character(who)
        del self._characters[who]
        return self._last_frames(character)

    def _last_frames(self, character: _Character) -> Iterator[MovedBody]:
        returned = max(character.frames - 1 - self._latency, 0)
        for row in character.smoother.finish() if character.smoother else ():
            self._advance([character], row[None])
        character.finish(self._model)
        for frame in range(returned + 1, character.frames):
            yield from self._moved([character], [frame])

    def _advance(self, characters: Sequence[_Character], theta: NDArray) -> None:
        """Add a frame, theta (B, 69), to each character, and all ticks up to it."""
        pairs = list(zip(characters, theta, strict=True))
        before = np.array([c.poses[-1] if c.poses else row for c, row in pairs])
        cuts = is_cut(before, theta)
        # Ticks before the frame after a cut belong to the old motion, which is extrapolated.
        targets = np.array([
            going_on(c.poses[-min(c.since_cut, 2)], c.poses[-1]) if cut else row
            for (c, row), cut in zip(pairs, cuts, strict=True)
        ])  # fmt: skip
        ticks = [self._clock.ticks(c.frames) for c in characters]
        for number in range(max(map(len, ticks))):
            rows = [row for row, numbers in enumerate(ticks) if number < len(numbers)]
            fractions = np.array([
                self._clock.fraction(ticks[row][number], characters[row].frames) for row in rows
            ])  # fmt: skip
            after = np.where(fractions[:, None] == 1, theta[rows], targets[rows])
            self._tick([characters[row] for row in rows], between(before[rows], after, fractions))
        for (character, pose), cut in zip(pairs, cuts, strict=True):
            character.warnings.check_cut(bool(cut))
            character.frames += 1
            character.poses.append(pose)
            character.since_cut = 1 if cut else character.since_cut + 1

    def _tick(self, characters: Sequence[_Character], theta: NDArray) -> None:
        """Add a tick, theta (B, 69), to each character; after a cut the tissue starts at rest."""
        model, pairs = self._model, list(zip(characters, theta, strict=True))
        before = np.array([c.ticks[-1] if c.ticks else row for c, row in pairs])
        states = []
        for (character, row), cut in zip(pairs, is_cut(before, theta), strict=True):
            if character.state is None or cut:
                character.finish(model)
                character.state = model.reset(character.betas[None], row[None])[0]
                character.since_start = 0
            states.append(character.state)
        states, codes = model.step(np.stack(states), theta)
        for (character, row), state, code in zip(pairs, states, codes, strict=True):
            character.state = state.copy()
            character.ticks.append(row)
            character.starts.append(character.since_start == 0)
            # During the look-ahead the model repeats the first tick's code.
            if not 0 < character.since_start <= model.look_ahead:
                character.codes.append(code.copy())
            character.since_start += 1

    def _moved(self, characters: Sequence[_Character], frames: Sequence[int]) -> list[MovedBody]:
        """The bodies of characters, each at one of its frames."""
        pairs = list(zip(characters, frames, strict=True))
        codes = [character.code_at(frame, self._clock) for character, frame in pairs]
        theta = np.stack([character.pose_at(frame) for character, frame in pairs])
        betas = np.stack([character.betas for character in characters])
        offsets_m = self._model.offsets_m(betas, np.stack(codes), theta)
        shaped = [character.shaped for character in characters]
        vertices_m = self._skin.pose(shaped, *unpack_theta(theta), offsets_m)
        latents = codes if self._model.codes_are_latents else [None] * len(codes)
        return [MovedBody(*parts) for parts in zip(vertices_m, offsets_m, latents, strict=True)]

    def _character(self, number: int) -> _Character:
        if number not in self._characters:
            raise DsnetError(
                f"character {number!r}",
                f"one of {', '.join(map(str, self._characters)) or '(there is none)'}",
                "Pass a number that join() gave; a character that has left may join again.",
            )
        return self._characters[number]


@dataclass(eq=False)
class _Character:
    """The state of one character; `Stream` numbers them."""

    shaped: ShapedBody
    betas: NDArray
    """(10,)."""
    smoother: StreamSmoother | None = None
    frames: int = 0
    """Number of frames so far, after the smoother if there is one."""
    poses: list[NDArray] = field(default_factory=list)
    """The newest poses, (69,) each."""
    since_cut: int = 0
    """Frames since the last cut."""
    warnings: PoseWarnings = field(default_factory=PoseWarnings)
    state: NDArray[np.float32] | None = None
    """(S,) of the model, after the newest tick."""
    since_start: int = 0
    """Ticks since the model was reset."""
    first: int = 0
    """Number of the first tick that is kept."""
    ticks: list[NDArray] = field(default_factory=list)
    """Poses (69,) of the kept ticks."""
    starts: list[bool] = field(default_factory=list)
    """Whether the model was reset at each kept tick."""
    codes: list[NDArray] = field(default_factory=list)
    """The model's results for the kept ticks; those of the newest come later."""

    def code_at(self, frame: int, clock: FrameClock) -> NDArray:
        """Code of a frame, interpolated between the ticks around it, but not across a cut."""
        tick, fraction = clock.place(frame)
        row = tick - self.first
        before, after = self.codes[row], self.codes[row + 1 : row + 2]
        if not (fraction and after):
            return before
        if not self.starts[row + 1]:
            return before + np.float32(fraction) * (after[0] - before)
        pose = self.pose_at(frame)
        return before if is_cut(pose[None], self.ticks[row + 1][None])[0] else after[0]

    def pose_at(self, frame: int) -> NDArray:
        """Pose (69,) of a frame, one of the newest."""
        return self.poses[frame - self.frames]

    def finish(self, model: Model) -> None:
        """Add the codes of the newest ticks, as if the motion ended here."""
        if self.state is not None:
            last = finished(model, self.state[None], self.ticks[-1][None])
            # In a motion shorter than the look-ahead the first ones are of ticks before it.
            last = last[max(model.look_ahead - self.since_start + 1, 0) :]
            self.codes += [codes[0] for codes in last]

    def forget(self, frame: int, clock: FrameClock) -> None:
        """Drop what later frames do not need; the last two poses are kept to find a cut."""
        old = min(clock.place(frame)[0] - self.first, len(self.ticks) - 1)
        del self.poses[: min(frame - self.frames, -2)]
        del self.ticks[:old], self.starts[:old], self.codes[:old]
        self.first += old
