"""Characters who move while one watches: frame by frame, at any frame rate, who come and go.

bodies = StreamingBodies(fps=90)  # or a run's: StreamingBodies("demo")
anna = bodies.join(betas)
moved = bodies.step({anna: theta})[anna]  # .vertices_m, .offsets_m
bodies.leave(anna)
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.body import BodyModelData
from bridge.body.embedded import EMBEDDED_GENDERS
from bridge.body.model_data import GENDERS
from bridge.body.posing import ShapedBody, Smpl
from bridge.errors import DsnetError, notify
from bridge.exchange.dsnet import TrainedDsnet, load_trained_dsnet
from bridge.motion import Motion, unpack_theta
from bridge.motion.cuts import is_cut
from bridge.motion.motion import FARTHEST_M, LARGEST_ANGLE_RAD, LARGEST_BETA
from bridge.motion.resampling import between, going_on
from bridge.motion.smoothing import StreamSmoother
from bridge.paper import N_BETAS, THETA_SIZE
from bridge.runs import Run
from bridge.runtime.load_model import body_asked, find_model, load_model
from bridge.runtime.moving_body import LARGEST_BODY_M, place_motion
from bridge.runtime.stepping import DsnetModel, Model, PlusModel, finished
from bridge.runtime.whose_betas import with_own_shape
from bridge.tissue.oscillators import FPS
from bridge.tissue.trained_plus import TrainedPlus

RATES_HZ = (10.0, 1000.0)
"""Slower than the slowest, motion between frames is guessed; faster, nobody shows it."""
_LARGEST_DENOMINATOR = 1001
"""Television's rates are thousands over 1001."""
_LARGEST_LIMB_RAD = 4 * np.pi
"""No limb turns twice about itself; in degrees one does in almost every pose."""
_CUTS_IN_A_ROW = 10
"""No recording has so many: something else is wrong with the poses."""
_MANY = 1000
"""Shape coefficients of a body file that are kept: all."""


class FrameClock:
    """Which ticks, 60 a second, at which models compute, lie where among frames of any rate.

    Counted in fractions, so it is never off. Frame 0 is at tick 0.
    """

    def __init__(self, fps: float) -> None:
        try:
            self.fps = float(fps)  # or a file's, which may be an array
        except (TypeError, ValueError):
            self.fps = math.nan
        if not RATES_HZ[0] <= self.fps <= RATES_HZ[1]:  # nan is not
            raise DsnetError(
                f"fps={fps}", f"{RATES_HZ[0]:g} to {RATES_HZ[1]:g}", "Pass frames per second."
            )
        per_tick = Fraction(self.fps).limit_denominator(_LARGEST_DENOMINATOR)
        self._per_frame = Fraction(int(FPS)) / per_tick

    def latency_frames(self, look_ahead: int) -> int:
        """Frames that an answer is late if a tick's is known `look_ahead` ticks later.

        The newest tick may lie almost a whole one before the newest frame.
        """
        return math.ceil(
            (look_ahead + 1 - Fraction(1, self._per_frame.denominator)) / self._per_frame
        )

    def ticks(self, frame: int) -> range:
        """Those after the frame before this one, up to this one."""
        before, now = (math.floor(f * self._per_frame) for f in (frame - 1, frame))
        return range(before + 1, now + 1) if frame else range(1)

    def share(self, tick: int, frame: int) -> float:
        """Where a tick of `ticks(frame)` lies from the frame before, 0, to this one, 1."""
        return float(tick / self._per_frame - (frame - 1)) if frame else 1.0

    def place(self, frame: int) -> tuple[int, float]:
        """The last tick not after a frame, and the share of a tick from there to the frame."""
        ticks = frame * self._per_frame
        return math.floor(ticks), float(ticks % 1)


class StreamingPredictor:
    """DSNet's latents step by step; remembers each character's past (Section 4.2).

    Parameters
    ----------
    run : name of a run whose stage `train` is finished, or a loaded `TrainedDsnet`.
    predictor : which of the run's networks; the run's own choice when None.
    """

    def __init__(
        self, run: str | os.PathLike[str] | TrainedDsnet, predictor: str | None = None
    ) -> None:
        if isinstance(run, (str, os.PathLike)):
            run = load_trained_dsnet(Run(os.fspath(run)).artifact("train"), predictor)
        self._model = DsnetModel(run)
        self.reset()

    def reset(self) -> None:
        """Forget the past; the next step may have another number of characters."""
        self._state = np.empty((0, 0), np.float32)

    def step(self, theta: NDArray, betas: NDArray) -> NDArray[np.float32]:
        """(B, 100) latents, as the autoencoder decodes them, one frame (1/60 s) later.

        `theta` (B, 69) are poses of B characters, in the same order at every step, `betas` (B, 10)
        their shapes. DsnetError if their shapes are others, B has changed since the last `reset`, a
        number is not finite, or a pose or shape is no person's. Then nothing has moved: go on with
        the next frame.
        """
        theta, betas = _numbers("theta", theta), _numbers("betas", betas)
        if theta.ndim != 2 or theta.shape[1] != THETA_SIZE or betas.shape != (len(theta), N_BETAS):
            raise DsnetError(
                f"theta {theta.shape} and betas {betas.shape}",
                f"theta (B, {THETA_SIZE}) and betas (B, {N_BETAS})",
                "Pass one row for each character, also for a single one.",
            )
        if len(self._state) not in (0, len(theta)):
            raise DsnetError(
                f"{len(theta)} characters after {len(self._state)}",
                "the same characters at every step",
                "Call reset() when characters come or go.",
            )
        _check_poses("theta", theta)
        if (largest := np.abs(betas).max(initial=0.0)) > LARGEST_BETA:
            raise DsnetError(
                f"betas with a coefficient of {largest:.3g}",
                f"at most {LARGEST_BETA:g}",
                "Pass betas within a few standard deviations of 0; nothing has moved.",
            )
        past = self._state if len(self._state) else self._model.reset(betas, theta)
        self._state, latents = self._model.step(self._model.reshaped(past, betas), theta)
        return latents


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
    begins anew there; who does so at each of ten frames is told of on stderr.

    The model computes 60 ticks a second. At another rate poses are interpolated to ticks, as
    `load_motion_file` resamples files of 60 and more frames a second (through slower ones it lays
    splines, which look ahead), and what is made of ticks to frames. Answers are `latency_frames`
    late: the model looks ahead by some ticks, and a frame needs the ticks before and after it.

    What is remembered of a person does not grow.

    Parameters
    ----------
    run : name of a run with a trained predictor, or a loaded `TrainedPlus`, then with its `body`;
        None for the small model that comes with the package.
    predictor : which of the run's; the run's best when None.
    body : the body model that moves, or its file or folder; `DSNET_BODY`, else the run's, when
        None.
    gender : of the packaged model's body, and of a folder's: `female`, `male` or `neutral`.
    fps : frames per second of what comes and goes, 10 to 1000.
    smooth : leave out the noise of a recording (`bridge.motion.smoothing`), three frames later.
    """

    def __init__(
        self,
        run: str | os.PathLike[str] | TrainedPlus | None = None,
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
        if isinstance(run, TrainedPlus):
            if not isinstance(body, BodyModelData):
                raise DsnetError("a model without a body", "the body it moves", "Pass body=.")
            self._model: Model = PlusModel(run, body)
        else:
            of = None if run is None else Run(os.fspath(run))
            if isinstance(body, BodyModelData):
                own = body.gender if body.gender in EMBEDDED_GENDERS else gender
                self._model = find_model(of, predictor, own).open(body)
            else:
                found = load_model(of, predictor, gender, body_asked(body), more_betas=_MANY)
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
        return place_motion(with_own_shape(motion, self._body), self._body)

    def join(self, betas: ArrayLike) -> int:
        """Let a person of shape betas in, (10,) or more if the body has; the number is hers, and
        never anybody else's.

        Takes, with her first step, longer than the steps after it: her tissue is brought to rest.
        """
        shape = _checked_betas(betas, self._body)
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
        rows = [_checked_pose(f"theta of character {who}", theta) for who, theta in poses.items()]
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
            character.frames += 1
            character.poses.append(pose)
            character.since_cut = 1 if jumps else character.since_cut + 1
            character.cuts_in_a_row = character.cuts_in_a_row + 1 if jumps else 0
            if character.cuts_in_a_row == _CUTS_IN_A_ROW:
                notify(
                    f"a streamed body leaps from each of {_CUTS_IN_A_ROW} frames to the next, so "
                    "no tissue moves: are its translations in metres, and every pose hers?"
                )

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
    cuts_in_a_row: int = 0
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


def _numbers(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """An array of finite numbers of what a user passed as `name`."""
    try:
        found = np.asarray(values)
        flaw = f"values of type {found.dtype}" if found.dtype.kind not in "iuf" else ""
    except (TypeError, ValueError) as error:
        found, flaw = np.empty(0), f"rows that fit no array ({error})"
    if flaw:
        raise DsnetError(f"{name} with {flaw}", "an array of numbers", "Pass finite real numbers.")
    array = found.astype(np.float64)
    if not np.isfinite(array).all():
        raise DsnetError(
            f"{name} with {int((~np.isfinite(array)).sum())} of {array.size} numbers not finite",
            "finite numbers",
            "Leave the frame out or repeat the last one; nothing has moved.",
        )
    return array


def _check_poses(name: str, theta: NDArray[np.float64]) -> None:
    """Refuse poses theta (B, 69) of finite numbers that no body takes."""
    pose, trans_m = unpack_theta(theta)
    angles_rad, far_m = np.linalg.norm(pose, axis=-1), np.abs(trans_m).max(initial=0.0)
    root_rad, limb_rad = (part.max(initial=0.0) for part in np.split(angles_rad, [1], axis=-1))
    if root_rad > LARGEST_ANGLE_RAD or limb_rad > _LARGEST_LIMB_RAD or far_m > FARTHEST_M:
        raise DsnetError(
            f"{name} with its root turned by {root_rad:.3g} rad, a limb by {limb_rad:.3g}, "
            f"{far_m:.3g} m off",
            f"at most {LARGEST_ANGLE_RAD:g}, {_LARGEST_LIMB_RAD:.3g} and {FARTHEST_M:g} m",
            "Angles are in radians and translations in metres; nothing has moved.",
        )


def _checked_pose(name: str, theta: ArrayLike) -> NDArray[np.float64]:
    """One person's pose (69,)."""
    found = _numbers(name, theta)
    if found.shape != (THETA_SIZE,):
        raise DsnetError(
            f"{name} of shape {found.shape}",
            f"({THETA_SIZE},): {THETA_SIZE - 3} of pose and 3 of translation",
            "Pack it with bridge.motion.pack_theta.",
        )
    _check_poses(name, found[None])
    return found


def _checked_betas(betas: ArrayLike, body: BodyModelData) -> NDArray[np.float64]:
    """One person's shape (S,), whose body is of a person's size; what is not given is 0."""
    found, count = _numbers("betas", betas), body.shapedirs.shape[-1]
    if found.ndim != 1 or not N_BETAS <= len(found) <= count:
        expected = f"({N_BETAS},)" + (f" to ({count},)" if count > N_BETAS else "")
        raise DsnetError(f"betas of shape {found.shape}", expected, "Pass one person's.")
    found = np.pad(found, (0, count - len(found)))
    with np.errstate(over="ignore", invalid="ignore"):
        size_m = np.ptp(body.v_template + body.shapedirs @ found, axis=0).max()
    if not size_m < LARGEST_BODY_M:
        raise DsnetError(
            f"betas of a body of {size_m:.3g} m",
            f"one of less than {LARGEST_BODY_M:g} m",
            "Pass betas within a few standard deviations of 0.",
        )
    return found
