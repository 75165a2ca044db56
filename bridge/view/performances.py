"""Skin offsets of chosen motions, predictors and shapes: computed in the background and kept."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from bridge.motion import Motion, unpack_theta
from bridge.motion.cuts import pieces_between_cuts
from bridge.runtime.skinning import ShapedBody
from bridge.view.latest_work import LatestWork, Steps
from bridge.view.repertoire import Repertoire
from bridge.view.truth import TRUTH, TrueMotion

SMPL_ALONE = "smpl"
LABELS = {SMPL_ALONE: "SMPL alone", TRUTH: TRUTH}
_MOST_BYTES = 1_500_000_000
_FRAMES_AT_ONCE = 64


@dataclass(frozen=True)
class Asked:
    """Whose offsets: the key that they are kept by."""

    take: str
    predictor: str
    betas: tuple[float, ...]
    """Ten shape coefficients."""


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
        self._clips: dict[Asked, Clip] = {}
        self._errors: dict[tuple[Asked, float], NDArray[np.float32]] = {}
        # Posing needs a shape's blended vertices; sliders bring many shapes, people few.
        self.shaped = lru_cache(8)(self._shaped)
        self.motion = lru_cache(8)(self._motion)
        self.truth = lru_cache(2)(self._truth)

    def _shaped(self, betas: tuple[float, ...]) -> ShapedBody:
        return ShapedBody(self.repertoire.body, np.array(betas))

    def _motion(self, take: str, betas: tuple[float, ...] | None = None) -> Motion:
        """A take for a shape, or as its own person moves; no longer than what is shown."""
        shape = None if betas is None else np.array(betas)
        motion = self.repertoire.takes[take].read(shape)
        known = self.repertoire.takes[take].frames
        end = max(min(int(self._most_s * motion.fps), known or len(motion.theta)), 1)
        return replace(motion, theta=motion.theta[:end])

    def _truth(self, take: str) -> TrueMotion | None:
        name, read = self.repertoire.takes[take].truth, self.repertoire.read_truth
        return None if name is None or read is None else read(name)

    def own_betas(self, take: str) -> tuple[float, ...]:
        """Ten shape coefficients of the person who moved."""
        return tuple(map(float, self.motion(take).betas))

    def knows_truth(self, take: str, betas: tuple[float, ...]) -> bool:
        """Whether it is known how this shape really moved in a motion."""
        return self.repertoire.takes[take].truth is not None and betas == self.own_betas(take)

    def clip(self, asked: Asked) -> Clip | None:
        """What has been computed of it."""
        return self._clips.get(asked)

    def want(self, wanted: Sequence[Asked], gain: float = 1.0) -> None:
        """Compute these, and where the truth is known their errors with a gain; nothing else.

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
            curve = asked, gain if asked.predictor != SMPL_ALONE else 1.0
            known = self.knows_truth(asked.take, asked.betas)
            if known and asked.predictor != TRUTH and curve not in self._errors:
                work[("error", *curve)] = partial(self._compare, *curve)
        self._forget(keep=len(wanted))
        self.worker.want(work)

    def _empty(self, asked: Asked) -> Clip:
        frames = len(self.motion(asked.take, asked.betas).theta)
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
            if truth := self.truth(asked.take):
                clip.add(truth.offsets_m)
            clip.ready = len(clip.offsets_m)
            return
        character = self.repertoire.open(asked.predictor)
        motion = self.motion(asked.take, asked.betas)
        for piece in pieces_between_cuts(motion.theta):
            for offsets_m in character.predict(motion.theta[piece], motion.betas).offsets_m:
                clip.add(offsets_m)
                yield

    def vertices_m(self, asked: Asked, frames: slice, gain: float = 1.0) -> NDArray[np.float32]:
        """(T', V, 3) posed meshes; SMPL alone in frames that are not computed yet."""
        clip = self._clips[asked]
        truth = self.truth(asked.take) if asked.predictor == TRUTH else None
        if truth is None:
            theta, shaped = self.motion(asked.take, asked.betas).theta, self.shaped(asked.betas)
        else:
            theta, shaped, gain = truth.theta, self.shaped(tuple(map(float, truth.betas))), 1.0
        pose, trans = unpack_theta(theta[frames])
        return shaped.pose(pose, trans, gain * clip.offsets_m[frames])

    def frames(self, asked: Asked) -> int:
        """How many frames can be shown."""
        return len(self._clips[asked].offsets_m)

    def errors_m(self, asked: Asked, gain: float) -> NDArray[np.float32] | None:
        """(T,) distance to the true mesh, mean over vertices, metres; None until it is known."""
        return self._errors.get((asked, gain if asked.predictor != SMPL_ALONE else 1.0))

    def _compare(self, asked: Asked, gain: float) -> Iterator[None]:
        true = Asked(asked.take, TRUTH, asked.betas)
        if true not in self._clips:
            self._clips[true] = clip = Clip(*self._clips[asked].offsets_m.shape[:2])
            yield from self._perform(true, clip)
        errors = []
        for start in range(0, self.frames(asked), _FRAMES_AT_ONCE):
            frames = slice(start, min(start + _FRAMES_AT_ONCE, self.frames(asked)))
            gap_m = self.vertices_m(asked, frames, gain) - self.vertices_m(true, frames)
            errors.append(np.linalg.norm(gap_m, axis=-1).mean(axis=-1))
            yield
        self._errors[asked, gain] = np.concatenate(errors)
