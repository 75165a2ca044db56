"""Bodies with moving tissue one frame at a time, who come and go while one watches; no framework.

bodies = StreamingBodies(fps=90)  # or a run's: StreamingBodies("demo")
anna = bodies.join(betas)
moved = bodies.step({anna: theta})[anna]  # .vertices_m, .offsets_m
bodies.leave(anna)
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.body import BodyModelData, load_body_model
from bridge.body.smpl import Smpl
from bridge.errors import DsnetError
from bridge.motion import unpack_theta
from bridge.runs import Run
from bridge.runtime.bounds import checked_betas, checked_pose
from bridge.runtime.characters import choose
from bridge.runtime.plus_step import PlusModel
from bridge.runtime.stepping import Model
from bridge.runtime.streams.frame_clock import FrameClock
from bridge.runtime.streams.streaming_character import StreamedCharacter, advanced
from bridge.tissue.trained_plus import TrainedPlus


@dataclass(frozen=True, eq=False)
class MovedBody:
    """One body at one frame."""

    vertices_m: NDArray[np.float32]
    """(V, 3) in the world."""
    offsets_m: NDArray[np.float32]
    """(V, 3) in the rest pose: for an engine that skins by itself."""
    latents: NDArray[np.float32] | None = None
    """(100,) that the offsets are decoded from, if they are."""


class StreamingBodies:
    """Moves any number of persons frame by frame: skin offsets and posed vertices.

    Each has her own past: what is made of her is independent of who else is there (vertices within
    a micrometre: matrix products of many round differently), of who joins and leaves, and the same
    as over the whole motion (offsets within 1e-5 m): both are loops over `Model.step`. She begins
    at rest in her first pose. Where a pose jumps as far as `bridge.motion.cuts` calls a cut, she
    begins anew there.

    The model computes 60 ticks a second. At another rate poses are interpolated to ticks, as
    `load_amass_motion` resamples, and what is made of ticks to frames. Answers are `latency_frames`
    late: the model looks ahead by some ticks, and a frame needs the ticks before and after it.

    What is remembered of a person does not grow.

    Parameters
    ----------
    run : name of a run with a trained predictor, or a loaded `TrainedPlus`, then with its `body`;
        None for the small model that comes with the package.
    predictor : which of the run's; the run's best when None.
    body : the body model that moves; the run's when None.
    gender : of the packaged model's body, `female` or `male`.
    fps : frames per second of what comes and goes, 10 to 1000.

    Raises
    ------
    DsnetError
        If there is no such run, predictor or rate, or a model comes without a body.
    """

    def __init__(
        self,
        run: str | os.PathLike[str] | TrainedPlus | None = None,
        predictor: str | None = None,
        *,
        body: BodyModelData | None = None,
        gender: str = "female",
        fps: float = 60.0,
    ) -> None:
        self._clock = FrameClock(fps)
        if isinstance(run, TrainedPlus):
            if body is None:
                raise DsnetError("a model without a body", "the body it moves", "Pass body=.")
            self._model: Model = PlusModel(run, body)
        else:
            chosen = choose(None if run is None else Run(os.fspath(run)), predictor, gender)
            body = body or load_body_model(chosen.body_model)
            self._model = chosen.open(body)
        self._body, self._skin = body, Smpl(body)
        self._characters: dict[int, StreamedCharacter] = {}
        self._numbers = count()
        self.latency_frames = self._clock.latency_frames(self._model.look_ahead)
        """How many frames ago was what `step` answers."""
        self.latency_s = self.latency_frames / self._clock.fps
        """The same in seconds."""

    @property
    def characters(self) -> tuple[int, ...]:
        """Those who are there, in the order in which they came."""
        return tuple(self._characters)

    def join(self, betas: ArrayLike) -> int:
        """Let a person of shape betas (10,) in; the number is hers, and never anybody else's.

        Takes, with her first step, longer than the steps after it: her tissue is brought to rest.

        Raises
        ------
        DsnetError
            If that is no person's shape.
        """
        shape = checked_betas(betas, self._body)
        character = StreamedCharacter(self._skin.person(shape), shape)
        who = next(self._numbers)
        self._characters[who] = character
        return who

    def step(self, poses: Mapping[int, ArrayLike]) -> dict[int, MovedBody]:
        """Advance those who are named by one frame of 1 / fps s; for others no time passes.

        Parameters
        ----------
        poses : theta (69,) by the number that `join` gave.

        Returns
        -------
        dict
            By the same numbers, each as she was `latency_frames` ago, or at her first frame if
            she has not been there for so long.

        Raises
        ------
        DsnetError
            If a number is nobody's, or a pose has another shape, numbers that are not finite or
            beyond all bounds. Then nobody has moved: go on with the next frame.
        """
        here = [self._character(who) for who in poses]
        if not here:
            return {}
        rows = [checked_pose(f"theta of character {who}", theta) for who, theta in poses.items()]
        now = advanced(here, np.stack(rows), self._clock, self._model)
        answered = [max(c.frames - 1 - self.latency_frames, 0) for c in now]
        moved = self._moved(now, answered)
        for who, character in zip(poses, now, strict=True):
            following = max(character.frames - self.latency_frames, 0)
            self._characters[who] = character.without(following, self._clock)
        return dict(zip(poses, moved, strict=True))

    def leave(self, who: int) -> Iterator[MovedBody]:
        """Let somebody go.

        Returns
        -------
        iterator
            The `latency_frames` last frames that she was given and that no step has answered, as
            if her motion ended there; each is computed when it is asked for.

        Raises
        ------
        DsnetError
            If the number is nobody's.
        """
        character = self._character(who)
        del self._characters[who]
        return self._owed(character)

    def _owed(self, character: StreamedCharacter) -> Iterator[MovedBody]:
        if character.frames:
            finished = character.finished(self._model)
            answered = max(character.frames - 1 - self.latency_frames, 0)
            for frame in range(answered + 1, character.frames):
                yield from self._moved([finished], [frame])

    def _moved(
        self, characters: Sequence[StreamedCharacter], frames: Sequence[int]
    ) -> list[MovedBody]:
        each = list(zip(characters, frames, strict=True))
        codes = [character.code_at(frame, self._clock) for character, frame in each]
        theta = np.stack([character.pose_at(frame) for character, frame in each])
        betas = np.stack([character.betas for character in characters])
        offsets_m = self._model.offsets_m(betas, np.stack(codes), theta)
        shaped = [character.shaped for character in characters]
        vertices_m = self._skin.pose(shaped, *unpack_theta(theta), offsets_m)
        latents = codes if self._model.codes_are_latents else [None] * len(codes)
        return [MovedBody(*parts) for parts in zip(vertices_m, offsets_m, latents, strict=True)]

    def _character(self, who: int) -> StreamedCharacter:
        if who not in self._characters:
            raise DsnetError(
                f"character {who!r}",
                f"one of {', '.join(map(str, self._characters)) or '(nobody is there)'}",
                "Pass the number that join() gave; who has left may join again.",
            )
        return self._characters[who]
