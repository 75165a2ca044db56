"""When a body stands still: only then can flesh be seen to swing out and come to rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.body import BodyModelData
from bridge.body.posing import joint_rotations, joint_transforms, shaped_joints
from bridge.motion import unpack_theta

STILL_BELOW_M_S = 0.1
"""Mean speed of the joints; who stands at ease sways by less."""
_MOVED_ABOVE_M_S = 0.3
_MOVED_WITHIN_S = 0.5
_LEAST_S = 0.6
_LAST_S = 0.2


@dataclass(frozen=True)
class StillSpan:
    """Frames through which a body stands still."""

    start: int
    stop: int
    """First frame beyond."""
    last: int
    """How many frames count as settled: one swing of soft flesh."""
    after_motion: bool
    """Whether the body moved just before."""

    @property
    def frames(self) -> slice:
        """All of them."""
        return slice(self.start, self.stop)

    @property
    def settled(self) -> slice:
        """The last ones."""
        return slice(self.stop - self.last, self.stop)


def joint_speed_m_s(
    body: BodyModelData, betas: ArrayLike, theta: ArrayLike, fps: float
) -> NDArray[np.float64]:
    """(T,) speed from frame to frame, mean over the joints; the first frame has the second's.

    Parameters
    ----------
    betas : (10,) shape.
    theta : (T, 69) pose and translation.
    """
    pose, trans = unpack_theta(np.asarray(theta, dtype=np.float64))
    joints = shaped_joints(body, np.asarray(betas, dtype=np.float64)[None])
    joints = joints.repeat(len(pose), axis=0)
    bones = joint_transforms(joint_rotations(body, pose), joints, body.parents, trans)
    places = np.einsum("bjxy,bjy->bjx", bones[..., :3, :3], joints) + bones[..., :3, 3]
    speed = np.linalg.norm(np.diff(places, axis=0), axis=-1).mean(axis=1) * fps
    return np.concatenate([speed[:1], speed]) if len(speed) else np.zeros(len(pose))


def still_spans(speed_m_s: ArrayLike, fps: float) -> list[StillSpan]:
    """Stretches of 0.6 s and more in which the body stands still, in order."""
    speed = np.asarray(speed_m_s)
    still = np.concatenate([[False], speed < STILL_BELOW_M_S, [False]])
    edges = np.flatnonzero(np.diff(still))
    spans = []
    for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if stop - start >= _LEAST_S * fps:
            before = speed[max(0, start - round(_MOVED_WITHIN_S * fps)) : start]
            moved = bool((before > _MOVED_ABOVE_M_S).any())
            spans.append(StillSpan(start, stop, max(1, round(_LAST_S * fps)), moved))
    return spans
