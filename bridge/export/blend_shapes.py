"""What moves before skinning, as few blend shapes: for formats that have a skeleton and shapes.

Joint rotations and skinning weights are SMPL's, exactly. What SMPL and the predictor add before
skinning, pose blend shapes and skin offsets, is some ten thousand numbers a frame, but few of its
directions matter in one motion. The principal ones of its frames become blend shapes, as many as
are needed, with a weight a frame: for each direction one shape along it and one against it, scaled
so that weights stay within 0 and 1, for Blender cuts off what is below.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bridge.body.posing import joint_rotations, pose_features, shaped_vertices
from bridge.runtime.moving_body import MovedFrames, MovingBody

FRAMES_FITTED = 256
"""At most so many frames, evenly spaced, are looked at for directions."""
MOST_SHAPES = 64
"""Directions at most; engines grow slow with more. A frame uses one shape of each."""
ENOUGH_M = 2e-4
"""Largest error of a vertex in the frames that are looked at, where fewer than the most do."""


class BlendShapes:
    """The blend shapes of a moving body, which is predicted twice: to find them, and their weights.

    Attributes
    ----------
    rest_m : (V, 3) what the shapes are added to, before skinning.
    names, shapes_m, weights : of K shapes; (K, V, 3) and (T, K), 0 to 1.
    error_m : the largest distance of a vertex from where it should be, before skinning.
    """

    def __init__(self, moving: MovingBody) -> None:
        self._body, self._pose = moving.body, moving.pose
        posedirs = self._body.posedirs
        self._posedirs = posedirs.reshape(-1, posedirs.shape[-1]).T.astype(np.float32)
        self._mean_m, self.directions = self._fitted(moving)
        shaped_m = shaped_vertices(self._body, moving.motion.betas[None])[0]
        self.rest_m = shaped_m + self._mean_m.reshape(-1, 3)
        self.error_m, found = 0.0, []
        for posed in moving.shown("shapes"):
            moved_m = self.displaced_m(posed)
            found.append(self._along(moved_m))
            self.error_m = max(self.error_m, self._missed_m(moved_m, found[-1]))
        self.names, self.shapes_m, self.weights = self._one_sided(np.concatenate(found))

    def _fitted(self, moving: MovingBody) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(3V,) the frames' mean, and as many directions (K, 3V), orthonormal, as they need."""
        chosen = np.linspace(0, len(moving) - 1, min(FRAMES_FITTED, len(moving)))
        chosen, kept = chosen.round().astype(int), []
        for posed in moving:
            inside = chosen[(chosen >= posed.frames.start) & (chosen < posed.frames.stop)]
            kept.append(self.displaced_m(posed)[inside - posed.frames.start])
        frames_m = np.concatenate(kept)
        self._mean_m = frames_m.mean(axis=0)
        _, size, directions = np.linalg.svd(frames_m - self._mean_m, full_matrices=False)
        # A direction that no frame takes is rounding.
        directions = directions[: np.count_nonzero(size > 1e-6 * max(size[0], 1e-9))]
        self.directions = directions[:MOST_SHAPES]
        weights_m = self._along(frames_m)
        for count in range(1, len(self.directions)):
            if self._missed_m(frames_m, weights_m[:, :count]) <= ENOUGH_M:
                return self._mean_m, self.directions[:count]
        return self._mean_m, self.directions

    def displaced_m(self, posed: MovedFrames) -> NDArray[np.float32]:
        """(T', 3V) of each frame's rest pose from the shaped body: before skinning, metres."""
        turns = joint_rotations(self._body, self._pose[posed.frames])
        features = pose_features(turns).astype(np.float32)
        moved_m = posed.offsets_m.reshape(len(posed), -1).copy()
        moved_m += features @ self._posedirs
        return moved_m

    def _along(self, moved_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """(T', K) how far displacements (T', 3V) go along the directions."""
        return np.asarray((moved_m - self._mean_m) @ self.directions.T, np.float32)

    def _missed_m(self, moved_m: NDArray[np.float32], along_m: NDArray[np.float32]) -> float:
        """Largest distance of a vertex that the first directions (T', K') leave."""
        missed = moved_m - self._mean_m - along_m @ self.directions[: along_m.shape[1]]
        return float(np.linalg.norm(missed.reshape(len(moved_m), -1, 3), axis=-1).max())

    def _one_sided(
        self, along_m: NDArray[np.float32]
    ) -> tuple[list[str], NDArray[np.float32], NDArray[np.float32]]:
        """Of all that some frame takes."""
        sides = {"plus": 1, "minus": -1}
        count = len(self.directions)
        names = [f"shape_{number:02d}_{side}" for side in sides for number in range(count)]
        sided_m = np.concatenate([(sign * along_m).clip(0) for sign in sides.values()], axis=1)
        taken, reach_m = np.flatnonzero(sided_m.any(axis=0)), sided_m.max(axis=0)
        directions = np.concatenate([sign * self.directions for sign in sides.values()])[taken]
        shapes_m = (directions * reach_m[taken, None]).reshape(len(taken), *self.rest_m.shape)
        return [names[n] for n in taken], shapes_m, sided_m[:, taken] / reach_m[taken]
