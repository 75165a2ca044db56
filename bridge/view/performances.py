"""Skin offsets of chosen motions, predictors and shapes: computed in the background and kept."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from bridge.body.parts import PARTS
from bridge.body.posing import Smpl
from bridge.body.shapes import find_shape
from bridge.motion import Motion, unpack_theta
from bridge.motion.cuts import pieces_between_cuts
from bridge.motion.loops import Lap
from bridge.runtime.controls import Floor, blended_gain, stage_motion
from bridge.runtime.stepping import Prediction, predict_loop, predict_whole
from bridge.view.repertoire import SMPL_ALONE, TRUTH, Repertoire, TrueMotion

_MOST_BYTES = 1_500_000_000
_FRAMES_AT_ONCE = 64

Steps = Callable[[], Iterator[None]]
"""Work in steps of well under a second: between two of them it can be dropped."""


@dataclass(frozen=True)
class Way:
    """How somebody moves, apart from the skin."""

    take: str
    """Which motion."""
    betas: tuple[float, ...]
    floor: Floor = "keep"
    loop: bool = False


@dataclass(frozen=True)
class Asked:
    """Whose offsets: the key that they are kept by."""

    way: Way
    predictor: str


@dataclass(frozen=True)
class Gains:
    """By what predicted offsets are multiplied."""

    of_all: float = 1.0
    of_parts: tuple[float, ...] = (1.0,) * len(PARTS)
    """Of `PARTS`, on top of it."""


AS_PREDICTED = Gains()


class Clip:
    """Offsets of T frames, filled from the first on while one looks at them."""

    def __init__(self, frames: int, vertices: int) -> None:
        self.offsets_m = np.zeros((frames, vertices, 3), np.float32)
        """(T, V, 3) in the rest pose, metres; 0 from frame `ready` on."""
        self.ready = 0

    @property
    def complete(self) -> bool:
        """Whether all frames are there."""
        return self.ready == len(self.offsets_m)

    def add(self, offsets_m: NDArray[np.float32]) -> None:
        """Put the next frames (T', V, 3) behind those that are there."""
        end = min(self.ready + len(offsets_m), len(self.offsets_m))
        self.offsets_m[self.ready : end] = offsets_m[: end - self.ready]
        self.ready = end


class LatestWork:
    """One thread that does pieces of work in the order in which they were last asked for."""

    def __init__(self) -> None:
        self.failed: dict[Hashable, Exception] = {}
        """What went wrong, by what was to be done; such work is not tried again."""
        self._wanted: dict[Hashable, Steps] = {}
        self._changed, self._stopped = threading.Condition(), False
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def want(self, work: Mapping[Hashable, Steps]) -> None:
        """Do this and nothing else; what is under way and still wanted goes on where it is."""
        with self._changed:
            self._wanted = {key: one for key, one in work.items() if key not in self.failed}
            self._changed.notify_all()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until nothing is left to do; False if that took too long."""
        with self._changed:
            return self._changed.wait_for(lambda: not self._wanted, timeout_s)

    def stop(self) -> None:
        """End the thread after its current step."""
        with self._changed:
            self._stopped, self._wanted = True, {}
            self._changed.notify_all()
        self._thread.join()

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._stopped or self._wanted)
                if self._stopped:
                    return
                key, steps = next(iter(self._wanted.items()))
            try:
                done = all(key in self._wanted for _ in steps())
            # A thread that dies would leave a viewer that waits for ever.
            except Exception as error:
                self.failed[key], done = error, True
            if done:
                with self._changed:
                    self._wanted.pop(key, None)
                    self._changed.notify_all()


class Performances:
    """Motions of one repertoire, and what moves in them.

    `most_s` seconds of each motion are shown: 5 MB each for every predictor.
    """

    def __init__(self, repertoire: Repertoire, most_s: float = 20.0) -> None:
        self.repertoire = repertoire
        self.worker = LatestWork()
        self._most_s = most_s
        self._clips: dict[Asked, Clip] = {}
        self._errors: dict[tuple[Asked, Gains], NDArray[np.float32]] = {}
        body, takes, skin = repertoire.body, repertoire.takes, Smpl(repertoire.body)
        # Posing needs a shape's blended vertices; sliders bring many shapes, people few.
        self._shaped = lru_cache(8)(lambda betas: skin.person(np.array(betas)))
        self._staged = lru_cache(8)(self._stage)
        self._own_motion = lru_cache(8)(lambda take: takes[take].read(None))
        self._truth = lru_cache(2)(self._read_truth)
        self._blended = lru_cache(8)(
            lambda gains: blended_gain(body, gains.of_all, gains.of_parts)[:, None]
        )

    def _stage(self, way: Way) -> tuple[Motion, Lap | None]:
        """A whole motion, and its lap if it is to repeat."""
        placed = self.repertoire.takes[way.take].read(np.array(way.betas))
        own = self._own_motion(way.take)
        return stage_motion(placed, self.repertoire.body, own, way.floor, way.loop)

    def motion(self, way: Way) -> Motion:
        """As much of a motion as is shown."""
        motion, lap = self._staged(way)
        known = None if lap else self.repertoire.takes[way.take].frames
        end = max(min(int(self._most_s * motion.fps), known or len(motion.theta)), 1)
        return replace(motion, theta=motion.theta[:end])

    def _read_truth(self, take: str) -> TrueMotion | None:
        name, read = self.repertoire.takes[take].truth, self.repertoire.read_truth
        return None if name is None or read is None else read(name)

    def own_betas(self, take: str) -> tuple[float, ...]:
        """Ten shape coefficients of the person who moved."""
        return tuple(map(float, self._own_motion(take).betas))

    def person_betas(self, name: str) -> tuple[float, ...]:
        """Those of one of the people, or of a shape by name, which the body may not have."""
        people = self.repertoire.people
        betas = people[name] if name in people else find_shape(self.repertoire.body, [name])
        return tuple(map(float, betas))

    def knows_truth(self, way: Way) -> bool:
        """Whether it is known how somebody really moved so: as the person did who moved."""
        recorded = way == Way(way.take, self.own_betas(way.take))
        return recorded and self.repertoire.takes[way.take].truth is not None

    def gain(self, asked: Asked, gains: Gains) -> float | NDArray[np.float32]:
        """Of its offsets: one number, or one for each vertex (V, 1); the truth has none."""
        if asked.predictor == TRUTH:
            return 1.0
        return gains.of_all if gains == Gains(gains.of_all) else self._blended(gains)

    def clip(self, asked: Asked) -> Clip | None:
        """What has been computed of it."""
        return self._clips.get(asked)

    def want(self, wanted: Sequence[Asked], gains: Gains = AS_PREDICTED) -> None:
        """Compute these, and where the truth is known their errors with gains; nothing else."""
        work: dict[Hashable, Steps] = {}
        for asked in wanted:
            self._clips[asked] = clip = self._clips.pop(asked, None) or self._empty(asked)
            if not clip.complete:
                work[asked] = partial(self._perform, asked, clip)
        for asked in wanted:
            curve = _curve(asked, gains)
            known = self.knows_truth(asked.way)
            if known and asked.predictor != TRUTH and curve not in self._errors:
                work[("error", *curve)] = partial(self._compare, *curve)
        # What was wanted longest ago is dropped: `_clips` is in order of wanting.
        size = sum(clip.offsets_m.nbytes for clip in self._clips.values())
        for asked in list(self._clips)[: -len(wanted) or None]:
            if size > _MOST_BYTES:
                size -= self._clips.pop(asked).offsets_m.nbytes
        self.worker.want(work)

    def _empty(self, asked: Asked) -> Clip:
        frames = len(self.motion(asked.way).theta)
        clip = Clip(frames, self.repertoire.body.vertex_count)
        if asked.predictor == SMPL_ALONE:
            clip.ready = frames
        return clip

    def _perform(self, asked: Asked, clip: Clip) -> Iterator[None]:
        clip.ready = 0  # of an earlier attempt that was dropped
        if asked.predictor == TRUTH:
            if truth := self._truth(asked.way.take):
                clip.add(truth.offsets_m)
            clip.ready = len(clip.offsets_m)
            return
        for prediction in self._predictions(asked):
            for offsets_m in prediction.offsets_m:
                clip.add(offsets_m)
                yield
                if clip.complete:
                    return

    def _predictions(self, asked: Asked) -> Iterator[Prediction]:
        """Of each piece between cuts, or of the loop, whole however little of it is shown."""
        predict = partial(predict_whole, self.repertoire.open(asked.predictor).model)
        motion, (_, loop) = self.motion(asked.way), self._staged(asked.way)
        if loop is not None:
            yield predict_loop(predict, loop, motion.betas)
            return
        for piece in pieces_between_cuts(motion.theta):
            yield predict(motion.theta[piece], motion.betas)

    def vertices_m(
        self, asked: Asked, frames: slice, gains: Gains = AS_PREDICTED
    ) -> NDArray[np.float32]:
        """(T', V, 3) posed meshes; SMPL alone in frames that are not computed yet."""
        offsets_m = self.gain(asked, gains) * self._clips[asked].offsets_m[frames]
        theta, betas = self.motion(asked.way).theta, asked.way.betas
        if asked.predictor == TRUTH and (truth := self._truth(asked.way.take)):
            theta, betas = truth.theta, tuple(map(float, truth.betas))
        return self._shaped(betas).pose(*unpack_theta(theta[frames]), offsets_m)

    def errors_m(self, asked: Asked, gains: Gains) -> NDArray[np.float32] | None:
        """(T,) distance to the true mesh, mean over vertices, metres; None until it is known."""
        return self._errors.get(_curve(asked, gains))

    def _compare(self, asked: Asked, gains: Gains) -> Iterator[None]:
        true, count = Asked(asked.way, TRUTH), len(self._clips[asked].offsets_m)
        if true not in self._clips:
            self._clips[true] = clip = Clip(*self._clips[asked].offsets_m.shape[:2])
            yield from self._perform(true, clip)
        errors = []
        for start in range(0, count, _FRAMES_AT_ONCE):
            frames = slice(start, min(start + _FRAMES_AT_ONCE, count))
            gap_m = self.vertices_m(asked, frames, gains) - self.vertices_m(true, frames)
            errors.append(np.linalg.norm(gap_m, axis=-1).mean(axis=-1))
            yield
        self._errors[asked, gains] = np.concatenate(errors)


def _curve(asked: Asked, gains: Gains) -> tuple[Asked, Gains]:
    """What its errors are kept by."""
    return asked, AS_PREDICTED if asked.predictor == SMPL_ALONE else gains
