"""Where a clip's bodies stand and from where they are seen: found by going through the motion once.

The bodies are turned so that they mostly look at the camera, a little to the side, and what they
walk along the floor is taken out smoothly; height above the floor stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, product

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from bridge.motion import unpack_theta
from bridge.report.panels import scale_top_m
from bridge.report.render import Camera, frame_camera
from bridge.runtime.moving_body import MovingBody

_SMOOTH_S = 0.5
_ASIDE_RAD = 0.35
_GAP_M = 0.15
_VERTICES_SKIPPED = 10
_FRAMES_MEASURED = 300
"""At most so many frames say how large offsets are."""


@dataclass(frozen=True, eq=False)
class ClipStage:
    """How to place the bodies of each frame, and what is common to all pictures."""

    turn: Rotation
    """About the vertical, of the whole motion."""
    path_m: NDArray[np.float64]
    """(T, 3) smoothed walk along the floor, before the turn; zero upwards."""
    apart_m: float
    """From one body to the next, to the right."""
    camera: Camera
    top_m: float
    """Size of skin offsets that gets the darkest colour."""

    def place(self, vertices_m: NDArray, frame: int, column: int) -> NDArray[np.float64]:
        """(V, 3) vertices of one frame where they are drawn, in a column from 0."""
        placed = self.turn.apply(vertices_m - self.path_m[frame])
        placed[:, 0] += column * self.apart_m
        return placed


def set_stage(moving: Sequence[MovingBody], step: int, width_px: int) -> ClipStage:
    """Predict the motion once and fit the camera to each `step`-th frame.

    Parameters
    ----------
    moving : the same motion by each predictor; before their columns is one for SMPL alone.
    width_px : of the picture.
    """
    motion = moving[0].motion
    pose, trans_m = unpack_theta(motion.theta)
    path_m = gaussian_filter1d(trans_m, _SMOOTH_S * motion.fps, axis=0, mode="nearest")
    path_m = path_m * [1.0, 0.0, 1.0]
    turn = turned_to_camera(pose, _ASIDE_RAD)
    looked_at = -(-len(motion.theta) // (step * _FRAMES_MEASURED))
    low, high, sizes_m = np.full(3, np.inf), np.full(3, -np.inf), []
    for posed in chain.from_iterable(one.shown("measure") for one in moving):
        for row in range(-posed.frames.start % step, len(posed), step):
            path_here_m = path_m[posed.frames.start + row]
            seen = turn.apply(posed.vertices_m[row, ::_VERTICES_SKIPPED] - path_here_m)
            low, high = np.minimum(low, seen.min(axis=0)), np.maximum(high, seen.max(axis=0))
            if (posed.frames.start + row) // step % looked_at == 0:
                sizes_m.append(np.linalg.norm(posed.offsets_m[row, ::_VERTICES_SKIPPED], axis=1))
    apart_m = high[0] - low[0] + _GAP_M
    high[0] += apart_m * len(moving)
    corners = np.array(list(product(*zip(low, high, strict=True))))
    camera = _camera(corners, width_px)
    return ClipStage(turn, path_m, apart_m, camera, scale_top_m(np.concatenate(sizes_m)))


def turned_to_camera(
    pose: NDArray, aside_rad: float, looked_at: tuple[float, float, float] = (0.0, 0.0, 1.0)
) -> Rotation:
    """About the vertical, so that a camera that looks along -z sees a motion's front.

    Parameters
    ----------
    pose : (T, 22, 3) of the motion, y up.
    aside_rad : by how much the camera stands aside.
    looked_at : what is to look at the camera, in the root's frame: the front, +z.
    """
    ahead = Rotation.from_rotvec(pose[:, 0]).apply(looked_at).mean(axis=0)
    return Rotation.from_euler("y", aside_rad - np.arctan2(ahead[0], ahead[2]))


def _camera(corners: NDArray[np.float64], width_px: int) -> Camera:
    size = np.ptp(corners, axis=0)
    height_px = width_px * (size[1] + 0.15 * size[2]) / size[0]
    height_px = int(np.clip(height_px, 0.4 * width_px, 1.2 * width_px)) // 2 * 2
    return frame_camera([corners], height_px=height_px, width_px=width_px, azimuth_deg=0.0)
