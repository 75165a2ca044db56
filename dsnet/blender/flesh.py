"""Soft tissue for the frames of a scene, and as shape keys. Needs no Blender.

Skin is predicted at 60 frames a second; at another rate a scene's frames take what lies between
two of them, so a scene of 60 has exactly what `dsnet predict` writes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.body.posing import ShapedBody, Smpl
from bridge.motion import Motion
from bridge.motion.resampling import prepared
from dsnet.blender.rest_mesh import MeshBody
from dsnet.prediction.controls import Controls, controlled_body
from dsnet.prediction.gains import GAINS
from dsnet.prediction.load_model import TrainedModel, load_model
from dsnet.prediction.moving_body import place_motion

LARGEST_GAIN = GAINS.most
ENOUGH_M = 2e-5
"""Largest error of a vertex at which no more shape keys are added."""
_UNIT = 0.5
"""A shape key's largest value at gain 1: Blender keeps values within 10, and a gain within 20."""


class SceneFlesh:
    """Offsets of the frames of a scene, predicted piece by piece.

    Parameters
    ----------
    motion : what `SceneArmature.motion` gives.
    controls : of the body; its gain is that of the scene, and not used here.
    """

    def __init__(
        self, trained: TrainedModel, motion: Motion, controls: Controls | None = None
    ) -> None:
        self.moving = controlled_body(trained, prepared(motion), controls or Controls())
        self.posed = place_motion(
            prepared(motion, fps=motion.fps), trained.body, self.moving.motion.betas
        )
        """(T, ...) at the scene's rate."""
        self.first = motion.rest_pose_frames
        """Frames of the scene before it, in which the armature is in its rest pose."""

    def __len__(self) -> int:
        return len(self.posed.theta)

    def warnings(self) -> list[str]:
        """About the motion, a line each."""
        return self.moving.warnings()

    def offsets(self) -> Iterator[NDArray[np.float32]]:
        """(T', V, 3) metres, of all T frames some at a time."""
        at = (np.arange(len(self)) * (self.moving.motion.fps / self.posed.fps)).round(6)
        at = at.clip(max=len(self.moving) - 1)
        cuts, kept = np.array(self.moving.motion.cuts, int), None
        for moved in self.moving:
            first = moved.frames.start - (kept is not None)
            pieces = [moved.offsets_m] if kept is None else [kept, moved.offsets_m]
            frames_m, kept = np.concatenate(pieces), moved.offsets_m[-1:]
            last = moved.frames.stop - 1
            is_end = last == len(self.moving) - 1
            here = at[(at >= first) & ((at < last) | is_end)]
            below = np.floor(here).astype(int)
            share = here - below
            share[np.isin(below + 1, cuts)] = 0.0  # skin does not pass through a cut
            after = (below + 1).clip(max=last)
            shares = share[:, None, None].astype(np.float32)
            between_m = (1 - shares) * frames_m[below - first] + shares * frames_m[after - first]
            if len(here):
                yield np.asarray(between_m, np.float32)

    def surfaces(self) -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]:
        """Places (T', V, 3) in the world, metres, z up, of SMPL alone and with `LARGEST_GAIN`."""
        body = self.moving.body
        person: ShapedBody = Smpl(body).person(self.posed.betas)
        pose, trans_m, start = self.posed.pose, self.posed.trans_m, 0
        for offsets_m in self.offsets():
            frames = slice(start, start := start + len(offsets_m))
            alone_m = person.pose(pose[frames], trans_m[frames])
            most_m = person.pose(pose[frames], trans_m[frames], LARGEST_GAIN * offsets_m)
            yield z_up(alone_m), z_up(most_m)


def z_up(places_m: NDArray) -> NDArray[np.float32]:
    """(..., 3) as Blender has them, from y up."""
    x, y, z = np.moveaxis(places_m, -1, 0)
    return np.stack([x, -z, y], axis=-1).astype(np.float32)


def flesh_of_mesh(made: MeshBody, motion: Motion, gender: str) -> SceneFlesh:
    """The flesh of a mesh in a scene; an embedded body's own model, or one that is carried over,
    which takes seconds the first time."""
    betas = Controls.of({"betas": made.betas})
    if made.body.source == "synthetic":
        return SceneFlesh(load_model(made.body.gender), motion, betas)
    trained = load_model(gender)
    return SceneFlesh(trained.on(made.body, made.body.name), motion, betas)


def flesh_beside(motion: Motion, gender: str, shape: Sequence[str]) -> SceneFlesh:
    """The flesh of an embedded body that moves as an armature does."""
    return SceneFlesh(load_model(gender), motion, Controls(shape=tuple(shape)))


@dataclass(frozen=True, eq=False)
class KeyShapes:
    """Offsets of T frames as K shape keys."""

    shapes_m: NDArray[np.float32]
    """(K, V, 3)."""
    values: NDArray[np.float32]
    """(T, K) at gain 1."""


class KeyFit:
    """Finds shape keys for offsets that come piece by piece: as many as bring every vertex of every
    frame within `ENOUGH_M`."""

    def __init__(self) -> None:
        self._directions: list[NDArray[np.float32]] = []
        self._values: list[NDArray[np.float32]] = []
        self._points = 0

    def add(self, offsets_m: NDArray[np.float32]) -> None:
        """Offsets (T', V, 3) of the next frames, metres."""
        left_m, values = offsets_m.reshape(len(offsets_m), -1).copy(), []
        self._points = offsets_m.shape[1]
        for direction in self._directions:
            values.append(left_m @ direction)
            left_m -= values[-1][:, None] * direction
        if _largest_m(left_m) > ENOUGH_M:
            turned, size, directions = np.linalg.svd(left_m, full_matrices=False)
            for one, direction in zip((turned * size).T, directions, strict=True):
                self._directions.append(direction)
                values.append(one)
                left_m -= one[:, None] * direction
                if _largest_m(left_m) <= ENOUGH_M:
                    break
        shape = (len(offsets_m), len(values))
        self._values.append(np.reshape(np.transpose(values), shape).astype(np.float32))

    def shapes(self) -> KeyShapes:
        """Those of all frames that were added."""
        count = len(self._directions)
        values = np.concatenate(
            [np.pad(one, ((0, 0), (0, count - one.shape[1]))) for one in self._values]
        )
        largest = np.abs(values).max(axis=0, initial=1e-9) / _UNIT
        directions = np.reshape(self._directions, (count, self._points, 3))
        shapes_m = (directions * largest[:, None, None]).astype(np.float32)
        return KeyShapes(shapes_m, values / largest)


def _largest_m(left_m: NDArray) -> float:
    return float(np.square(left_m.reshape(len(left_m), -1, 3)).sum(-1).max(initial=0) ** 0.5)
