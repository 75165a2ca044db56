"""Skin offsets of chosen motions, predictors and shapes: computed in the background and kept."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from bridge.body.posing import ShapedBody, Smpl
from bridge.body.shapes import find_shape
from bridge.motion import Motion, unpack_theta
from bridge.motion.cuts import pieces_between_cuts
from bridge.motion.loops import Lap
from bridge.runtime.controls import blended_gain, stage_motion
from bridge.runtime.stepping import Prediction, predict_loop, predict_whole
from bridge.view.clips import AS_PREDICTED, SMPL_ALONE, Asked, Clip, Gains, Way
from bridge.view.latest_work import LatestWork, Steps
from bridge.view.repertoire import Repertoire
from bridge.view.truth import TRUTH, TrueMotion

_MOST_BYTES = 1_500_000_000
_FRAMES_AT_ONCE = 64


class Performances:
    """Motions of one repertoire, and what moves in them.

    Parameters
    ----------
    most_s : seconds of each motion that are shown; 5 MB each for every predictor.
    """

    def __init__(self, repertoire: Repertoire, most_s: float = 20.0) -> None:
        self.repertoire = repertoire
        self.worker = LatestWork()
        self._most_s = most_s
        self._skin = Smpl(repertoire.body)
        self._clips: dict[Asked, Clip] = {}
        self._errors: dict[tuple[Asked, Gains], NDArray[np.float32]] = {}
        # Posing needs a shape's blended vertices; sliders bring many shapes, people few.
        self.shaped = lru_cache(8)(self._shaped)
        self.staged = lru_cache(8)(self._staged)
        self.own_motion = lru_cache(8)(self._own_motion)
        self.person_betas = lru_cache(64)(self._person_betas)
        self.truth = lru_cache(2)(self._truth)
        self._blended = lru_cache(8)(self._blended_gain)

    def _shaped(self, betas: tuple[float, ...]) -> ShapedBody:
        return self._skin.person(np.array(betas))

    def _staged(self, way: Way) -> tuple[Motion, Lap | None]:
        """A whole motion, and its lap if it is to repeat."""
        placed, own = (
            self.repertoire.takes[way.take].read(np.array(way.betas)),
            self.own_motion(way.take),
        )
        return stage_motion(placed, self.repertoire.body, own, way.floor, way.loop)

    def motion(self, way: Way) -> Motion:
        """As much of a motion as is shown."""
        motion, lap = self.staged(way)
        known = None if lap else self.repertoire.takes[way.take].frames
        end = max(min(int(self._most_s * motion.fps), known or len(motion.theta)), 1)
        return replace(motion, theta=motion.theta[:end])

    def _truth(self, take: str) -> TrueMotion | None:
        name, read = self.repertoire.takes[take].truth, self.repertoire.read_truth
        return None if name is None or read is None else read(name)

    def _own_motion(self, take: str) -> Motion:
        return self.repertoire.takes[take].read(None)

    def own_betas(self, take: str) -> tuple[float, ...]:
        """Ten shape coefficients of the person who moved."""
        return tuple(map(float, self.own_motion(take).betas))

    def _person_betas(self, name: str) -> tuple[float, ...]:
        """Those of one of the people, or of a shape by name.

        Raises
        ------
        DsnetError
            If the body has no such shape.
        """
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

    def _blended_gain(self, gains: Gains) -> NDArray[np.float32]:
        return blended_gain(self.repertoire.body, gains.of_all, gains.of_parts)[:, None]

    def clip(self, asked: Asked) -> Clip | None:
        """What has been computed of it."""
        return self._clips.get(asked)

    def want(self, wanted: Sequence[Asked], gains: Gains = AS_PREDICTED) -> None:
        """Compute these, and where the truth is known their errors with gains; nothing else.

        Raises
        ------
        DsnetError
            If a motion or a predictor cannot be read.
        """
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
        self._forget(keep=len(wanted))
        self.worker.want(work)

    def _empty(self, asked: Asked) -> Clip:
        frames = len(self.motion(asked.way).theta)
        clip = Clip(frames, self.repertoire.body.vertex_count)
        if asked.predictor == SMPL_ALONE:
            clip.ready = frames
        return clip

    def _forget(self, keep: int) -> None:
        """Drop what was wanted longest ago; `_clips` is in order of wanting."""
        size = sum(clip.offsets_m.nbytes for clip in self._clips.values())
        for asked in list(self._clips)[: -keep or None]:
            if size > _MOST_BYTES:
                size -= self._clips.pop(asked).offsets_m.nbytes

    def _perform(self, asked: Asked, clip: Clip) -> Iterator[None]:
        clip.ready = 0  # of an earlier attempt that was dropped
        if asked.predictor == TRUTH:
            if truth := self.truth(asked.way.take):
                clip.add(truth.offsets_m)
            clip.ready = len(clip.offsets_m)
            return
        # A lap is predicted as a whole, however little of it is shown.
        motion = self.staged(asked.way)[0] if asked.way.loop else self.motion(asked.way)
        for prediction in self._predictions(asked, motion):
            for offsets_m in prediction.offsets_m:
                clip.add(offsets_m)
                yield
                if clip.complete:
                    return

    def _predictions(self, asked: Asked, motion: Motion) -> Iterator[Prediction]:
        """Of each piece between cuts, or of the loop."""
        predict = partial(predict_whole, self.repertoire.open(asked.predictor).model)
        _, loop = self.staged(asked.way)
        if loop is None:
            for piece in pieces_between_cuts(motion.theta):
                yield predict(motion.theta[piece], motion.betas)
            return

        # Rounds are predicted in one step until they agree, while a hand may ask for another shape.
        def droppable(theta: NDArray, betas: NDArray) -> Prediction:
            found = predict(theta, betas)
            return replace(found, offsets_m=self._dropped(asked, found.offsets_m))

        yield predict_loop(droppable, loop, motion.betas)

    def _dropped(
        self, asked: Asked, pieces: Iterator[NDArray[np.float32]]
    ) -> Iterator[NDArray[np.float32]]:
        for piece in pieces:
            self.worker.go_on(asked)
            yield piece

    def vertices_m(
        self, asked: Asked, frames: slice, gains: Gains = AS_PREDICTED
    ) -> NDArray[np.float32]:
        """(T', V, 3) posed meshes; SMPL alone in frames that are not computed yet."""
        offsets_m = self.gain(asked, gains) * self._clips[asked].offsets_m[frames]
        truth = self.truth(asked.way.take) if asked.predictor == TRUTH else None
        if truth is None:
            theta, shaped = self.motion(asked.way).theta, self.shaped(asked.way.betas)
        else:
            theta, shaped = truth.theta, self.shaped(tuple(map(float, truth.betas)))
        pose, trans = unpack_theta(theta[frames])
        return shaped.pose(pose, trans, offsets_m)

    def frames(self, asked: Asked) -> int:
        """How many frames can be shown."""
        return len(self._clips[asked].offsets_m)

    def errors_m(self, asked: Asked, gains: Gains) -> NDArray[np.float32] | None:
        """(T,) distance to the true mesh, mean over vertices, metres; None until it is known."""
        return self._errors.get(_curve(asked, gains))

    def _compare(self, asked: Asked, gains: Gains) -> Iterator[None]:
        true = Asked(asked.way, TRUTH)
        if true not in self._clips:
            self._clips[true] = clip = Clip(*self._clips[asked].offsets_m.shape[:2])
            yield from self._perform(true, clip)
        errors = []
        for start in range(0, self.frames(asked), _FRAMES_AT_ONCE):
            frames = slice(start, min(start + _FRAMES_AT_ONCE, self.frames(asked)))
            gap_m = self.vertices_m(asked, frames, gains) - self.vertices_m(true, frames)
            errors.append(np.linalg.norm(gap_m, axis=-1).mean(axis=-1))
            yield
        self._errors[asked, gains] = np.concatenate(errors)


def _curve(asked: Asked, gains: Gains) -> tuple[Asked, Gains]:
    """What its errors are kept by."""
    return asked, AS_PREDICTED if asked.predictor == SMPL_ALONE else gains
