"""A motion's rest-pose bodies as a few blend shapes: what a skeleton and its weights do not do.

What SMPL adds before skinning, pose blend shapes and skin offsets, is some ten thousand numbers a
frame, but few of its directions matter in one motion. The principal ones of its frames are blend
shapes, orthogonal, as many as are needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.posing import joint_rotations, pose_features, shaped_vertices
from bridge.motion import unpack_theta
from bridge.runtime.moving_body import MovedFrames, MovingBody

FRAMES_FITTED = 256
"""At most so many frames, evenly spaced, are looked at for directions."""
MOST_SHAPES = 64
"""Directions at most; engines grow slow with more. A frame uses one shape of each."""
ENOUGH_M = 2e-4
"""Largest error of a vertex in the frames that are looked at, where fewer than the most do."""


class RestBodies:
    """A moving body before skinning: template, shape, pose blend shapes and skin offsets."""

    def __init__(self, moving: MovingBody) -> None:
        body: BodyModelData = moving.body
        self._body, self._theta = body, moving.motion.theta
        self.shaped_m = shaped_vertices(body, moving.motion.betas[None])[0]
        self._posedirs = body.posedirs.reshape(-1, body.posedirs.shape[-1]).T.astype(np.float32)

    def __call__(self, posed: MovedFrames) -> NDArray[np.float32]:
        """(T', 3V) displacement of each frame's rest pose from the shaped body, metres."""
        rotations = joint_rotations(self._body, unpack_theta(self._theta[posed.frames])[0])
        moved_m = posed.offsets_m.reshape(len(posed), -1).copy()
        moved_m += pose_features(rotations).astype(np.float32) @ self._posedirs
        return moved_m


@dataclass(frozen=True, eq=False)
class BlendShapes:
    """K directions in which a body's rest pose moves."""

    mean_m: NDArray[np.float32]
    """(3V,) from the shaped body, metres."""
    directions: NDArray[np.float32]
    """(K, 3V) orthonormal."""

    def weights_m(self, moved_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """(T', K) of displacements (T', 3V)."""
        return np.asarray((moved_m - self.mean_m) @ self.directions.T, np.float32)

    def error_m(self, moved_m: NDArray[np.float32], weights_m: NDArray[np.float32]) -> float:
        """Largest distance of a vertex from where it should be, metres."""
        missed = moved_m - self.mean_m - weights_m @ self.directions
        return float(np.linalg.norm(missed.reshape(len(moved_m), -1, 3), axis=-1).max())


def fit_blend_shapes(moving: MovingBody, rest: RestBodies) -> BlendShapes:
    """Predict the motion once, and find as many directions as its frames need."""
    chosen = np.linspace(0, len(moving) - 1, min(FRAMES_FITTED, len(moving))).round().astype(int)
    kept = []
    for posed in moving:
        inside = chosen[(chosen >= posed.frames.start) & (chosen < posed.frames.stop)]
        kept.append(rest(posed)[inside - posed.frames.start])
    frames_m = np.concatenate(kept)
    mean_m = frames_m.mean(axis=0)
    _, size, directions = np.linalg.svd(frames_m - mean_m, full_matrices=False)
    # A direction that no frame takes is rounding.
    directions = directions[: np.count_nonzero(size > 1e-6 * max(size[0], 1e-9))]
    found = BlendShapes(mean_m, directions[:MOST_SHAPES])
    weights_m = found.weights_m(frames_m)
    for count in range(1, len(found.directions)):
        fewer = BlendShapes(mean_m, found.directions[:count])
        if fewer.error_m(frames_m, weights_m[:, :count]) <= ENOUGH_M:
            return fewer
    return found
