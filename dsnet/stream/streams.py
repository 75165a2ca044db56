"""Characters who move while one watches: frame by frame, at any frame rate, who come and go.

bodies = dsnet.Stream(fps=90)  # or a run's: dsnet.Stream("demo")
anna = bodies.join(betas)
moved = bodies.step({anna: theta})[anna]  # .vertices_m, .offsets_m
bodies.leave(anna)
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
from bridge.motion.resampling import between, going_on
from bridge.motion.smoothing import StreamSmoother
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.prediction.load_model import Source, find_model, load_model, requested_body
from dsnet.prediction.models import Model, PlusModel, finished
from dsnet.prediction.moving_body import place_motion
from dsnet.prediction.shape_space import with_betas_on
from dsnet.stream.frame_clock import FrameClock
from dsnet.stream.stream_checks import Oddities, checked_betas, checked_pose

_MANY = 1000
"""Shape coefficients of a body file that are kept: all."""


@dataclass(frozen=True, eq=False)
class MovedBody:
    """One body at one frame."""

    vertices_m: NDArray[np.float32]
    """(V, 3) in the world."""
    offsets_m: NDArray[np.float32]
    """(V, 3) in the rest pose: for an engine that skins by itself."""
    latents: NDArray[np.float32] | None = None
    """(100,) that the offsets are decoded from, if they are."""


class Stream:
    """Moves any number of persons frame by frame: skin offsets and posed vertices.

    Each has her own past: what is made of her is independent of who else is there (vertices within
    a micrometre: matrix products of many round differently), of who joins and leaves, and the same
    as over the whole motion (offsets within 1e-5 m): both are loops over `Model.step`. She begins
    at rest in her first pose. Where a pose jumps as far as `bridge.motion.cuts` calls a cut, she
    begins anew there. Who does so at each of ten frames, or whose poses come twice, is told of on
    stderr.

    The model computes 60 ticks a second. At another rate poses are interpolated to ticks, as
    `load_motion` resamples files of 60 and more frames a second (through slower ones it lays
    splines, which look ahead), and what is made of ticks to frames. Answers are `latency_frames`
    late: the model looks ahead by some ticks, and a frame needs the ticks before and after it.

    What is remembered of a person does not grow.

    Parameters
    ----------
    model : what `load_model` gives or takes: None for the small model that comes with the package,
        a run's name, a folder that `TrainedModel.save` wrote; or a `TrainedPlus`, then with its
        `body`.
    predictor : which of the run's; the run's best when None.
    body : the body model that moves, or its file or folder; `DSNET_BODY`, else the run's, when
        None.
    gender : of the packaged model's body, and of a folder's: `female`, `male` or `neutral`.
    fps : frames per second of what comes and goes, 10 to 1000.
    smooth : leave out the noise of a recording (`bridge.motion.smoothing`), three frames later.
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
                own = body.gender if body.gender in EMBEDDED_GENDERS else gender
                self._model = find_model(model, predictor, own).open(body)
            else:
                found = load_model(model, predictor, gender, requested_body(body), more_betas=_MANY)
                self._model, body = found.model, found.body
        self._body, self._skin = body, Smpl(body, hands=False)
        self._characters: dict[int, _Character] = {}
        self._numbers = count()
        self._late = self._clock.latency_frames(self._model.look_ahead)
        self.latency_frames = self._late + (StreamSmoother.look_ahead if smooth else 0)
        """How many frames ago was what `step` answers."""
        self.latency_s = self.latency_frames / self._clock.fps
        """The same in seconds."""

    @property
    def characters(self) -> tuple[int, ...]:
        """Those who are there, in the order in which they came."""
        return tuple(self._characters)

    def placed(self, motion: Motion) -> Motion:
        """A motion as its file has it, made one of these bodies: its `betas` are for `join`, its
        `theta`, y up and about the body's own root joint, for `step`.
        """
        return place_motion(with_betas_on(motion, self._body), self._body)

    def join(self, betas: ArrayLike) -> int:
        """Let a person of shape betas in, (10,) or more if the body has; the number is hers, and
        never anybody else's.

        Takes, with her first step, longer than the steps after it: her tissue is brought to rest.
        """
        shape = checked_betas(betas, self._body)
        smoother = StreamSmoother(self._clock.fps) if self._smooth else None
        character = _Character(self._skin.person(shape), shape, smoother)
        who = next(self._numbers)
        self._characters[who] = character
        return who

    def step(self, poses: Mapping[int, ArrayLike]) -> dict[int, MovedBody]:
        """Advance those who are named by one frame of 1 / fps s; for others no time passes.

        `poses` are theta (69,) by the number that `join` gave; the answer has, by the same
        numbers, each as she was `latency_frames` ago, or at her first frame if she has not been
        there for so long. DsnetError if a number is nobody's, or a pose has another shape, numbers
        that are not finite or beyond all bounds. Then nobody has moved: go on with the next frame.
        """
        here = [self._character(who) for who in poses]
        if not here:
            return {}
        rows = [checked_pose(f"theta of character {who}", theta) for who, theta in poses.items()]
        for character, row in zip(here, rows, strict=True):
            character.odd.hear(row, self._clock.fps)
        calm = [
            c.smoother.push(row) if c.smoother else row for c, row in zip(here, rows, strict=True)
        ]
        known = [(c, row) for c, row in zip(here, calm, strict=True) if row is not None]
        if known:
            self._advance([c for c, _ in known], np.stack([row for _, row in known]))
        moved = self._moved(here, [max(c.frames - 1 - self._late, 0) for c in here])
        for character in here:
            character.forget(max(character.frames - self._late, 0), self._clock)
        return dict(zip(poses, moved, strict=True))

    def leave(self, who: int) -> Iterator[MovedBody]:
        """Let somebody go; gives the `latency_frames` last frames that she was given and no step
        has answered, as if her motion ended there, each computed when it is asked for."""
        character = self._character(who)
        del self._characters[who]
        return self._owed(character)

    def _owed(self, character: _Character) -> Iterator[MovedBody]:
        answered = max(character.frames - 1 - self._late, 0)
        for row in character.smoother.finish() if character.smoother else ():
            self._advance([character], row[None])
        character.finish(self._model)
        for frame in range(answered + 1, character.frames):
            yield from self._moved([character], [frame])

    def _advance(self, characters: Sequence[_Character], theta: NDArray) -> None:
        """Give each one frame more, of theta (B, 69), and all ticks up to it."""
        each = list(zip(characters, theta, strict=True))
        before = np.array([c.poses[-1] if c.poses else row for c, row in each])
        cut = is_cut(before, theta)
        # Ticks before a cut's frame are still the old motion's, which goes on as it did.
        towards = np.array([
            going_on(c.poses[-min(c.since_cut, 2)], c.poses[-1]) if jumps else row
            for (c, row), jumps in zip(each, cut, strict=True)
        ])  # fmt: skip
        ticks = [self._clock.ticks(c.frames) for c in characters]
        for turn in range(max(map(len, ticks))):
            rows = [row for row, numbers in enumerate(ticks) if turn < len(numbers)]
            some = [characters[row] for row in rows]
            share = np.array([
                self._clock.share(ticks[row][turn], characters[row].frames) for row in rows
            ])  # fmt: skip
            after = np.where(share[:, None] == 1, theta[rows], towards[rows])
            self._tick(some, between(before[rows], after, share))
        for (character, pose), jumps in zip(each, cut, strict=True):
            character.odd.leap(bool(jumps))
            character.frames += 1
            character.poses.append(pose)
            character.since_cut = 1 if jumps else character.since_cut + 1

    def _tick(self, characters: Sequence[_Character], theta: NDArray) -> None:
        """Give each one tick more, of theta (B, 69); after a cut tissue begins anew, at rest."""
        model, each = self._model, list(zip(characters, theta, strict=True))
        before = np.array([c.ticks[-1] if c.ticks else row for c, row in each])
        states = []
        for (character, row), jumps in zip(each, is_cut(before, theta), strict=True):
            if character.state is None or jumps:
                character.finish(model)
                character.state = model.reset(character.betas[None], row[None])[0]
                character.since_begin = 0
            states.append(character.state)
        states, codes = model.step(np.stack(states), theta)
        for (character, row), state, code in zip(each, states, codes, strict=True):
            character.state = state.copy()
            character.ticks.append(row)
            character.begins.append(character.since_begin == 0)
            # The first tick's code comes again until another's is known.
            if not 0 < character.since_begin <= model.look_ahead:
                character.codes.append(code.copy())
            character.since_begin += 1

    def _moved(self, characters: Sequence[_Character], frames: Sequence[int]) -> list[MovedBody]:
        each = list(zip(characters, frames, strict=True))
        codes = [character.code_at(frame, self._clock) for character, frame in each]
        theta = np.stack([character.pose_at(frame) for character, frame in each])
        betas = np.stack([character.betas for character in characters])
        offsets_m = self._model.offsets_m(betas, np.stack(codes), theta)
        shaped = [character.shaped for character in characters]
        vertices_m = self._skin.pose(shaped, *unpack_theta(theta), offsets_m)
        latents = codes if self._model.codes_are_latents else [None] * len(codes)
        return [MovedBody(*parts) for parts in zip(vertices_m, offsets_m, latents, strict=True)]

    def _character(self, who: int) -> _Character:
        if who not in self._characters:
            raise DsnetError(
                f"character {who!r}",
                f"one of {', '.join(map(str, self._characters)) or '(nobody is there)'}",
                "Pass the number that join() gave; who has left may join again.",
            )
        return self._characters[who]


@dataclass(eq=False)
class _Character:
    """All that one's future depends on."""

    shaped: ShapedBody
    betas: NDArray
    """(10,)."""
    smoother: StreamSmoother | None = None
    frames: int = 0
    """That she was given, of a smoother those that it has answered."""
    poses: list[NDArray] = field(default_factory=list)
    """The newest of them, (69,) each."""
    since_cut: int = 0
    """How many frames."""
    odd: Oddities = field(default_factory=Oddities)
    state: NDArray[np.float32] | None = None
    """(S,) the model's, after the newest tick."""
    since_begin: int = 0
    """How many ticks that state has seen."""
    first: int = 0
    """Number of the first tick that is kept."""
    ticks: list[NDArray] = field(default_factory=list)
    """Poses (69,) from that tick on."""
    begins: list[bool] = field(default_factory=list)
    """Whether the tissue begins there, at rest."""
    codes: list[NDArray] = field(default_factory=list)
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

    def finish(self, model: Model) -> None:
        """All codes are known where she stops."""
        if self.state is not None:
            owed = finished(model, self.state[None], self.ticks[-1][None])
            # Of a motion shorter than the look-ahead the first are those before its beginning.
            owed = owed[max(model.look_ahead - self.since_begin + 1, 0) :]
            self.codes += [codes[0] for codes in owed]

    def forget(self, frame: int, clock: FrameClock) -> None:
        """Keep what frames from this one on need, and what tells a cut to the next."""
        old = min(clock.place(frame)[0] - self.first, len(self.ticks) - 1)
        del self.poses[: min(frame - self.frames, -2)]
        del self.ticks[:old], self.begins[:old], self.codes[:old]
        self.first += old
