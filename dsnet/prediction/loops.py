"""Motions that repeat: whether the last frame leads into the first, and cycles one after another.

Between two cycles the body may have travelled and turned about the vertical; that rigid map lays
each cycle behind the one before it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.errors import DsnetError
from bridge.motion.readers.amass import CYCLE, SAMPLE_PREFIX
from bridge.motion.theta import pack_theta, unpack_theta

SMOOTH_DEG, SMOOTH_M = 2.0, 0.005
"""By how much the step of a joint, and of the root's place, may change from frame to frame over the
seam, where they change by no more than that within the motion."""
REMEDY = f"Cut the motion to whole cycles, as {SAMPLE_PREFIX}{CYCLE} is, or leave out --loop."
_SAME_DEG, _SAME_M = 0.01, 1e-4
_LEAST_FRAMES = 5


@dataclass(frozen=True, eq=False)
class Loop:
    """One cycle of a repeating motion, y up, and the rigid map to the next one."""

    theta: NDArray[np.floating]
    """(T, 69) pose vectors; the frame after the last is the first, mapped."""
    dropped: bool
    """Whether the file had the first frame again at its end."""
    turn_rad: float
    """By which the next cycle is turned about the vertical."""
    shift_m: NDArray[np.float64]
    """(3,) where the turned first place of the root joint goes, horizontally."""
    root_joint_m: NDArray[np.float64]
    """(3,) the root joint of the body at rest."""

    def repeated(self, count: int) -> NDArray[np.floating]:
        """(count T, 69) cycles, each where the one before it ended; the first is `theta`."""
        pose, trans_m = unpack_theta(self.theta)
        turn = _about(self.turn_rad)
        turned, places = Rotation.from_rotvec(pose[:, 0]), trans_m + self.root_joint_m
        cycles = []
        for _ in range(count):
            root = turned.as_rotvec()[:, None]
            rotations = np.concatenate([root, pose[:, 1:]], axis=1)
            cycles.append(pack_theta(rotations, places - self.root_joint_m))
            turned, places = turn * turned, turn.apply(places) + self.shift_m
        return np.concatenate(cycles)


def close_loop(theta: NDArray, root_joint_m: NDArray) -> Loop:
    """A motion (T, 69), y up, as a cycle that leads into the next.

    If its last frame is its first again, but for the way it has gone, it is dropped. Otherwise
    the next cycle begins one frame after the last, as fast as the body moves before and after. A
    motion that jerks over the seam as it does nowhere else is refused.

    Parameters
    ----------
    root_joint_m : (3,) the root joint of the body at rest, metres.
    """
    if len(theta) < _LEAST_FRAMES:
        raise DsnetError(
            f"--loop with a motion of {len(theta)} frames",
            f"{_LEAST_FRAMES} or more",
            "Pass a longer motion.",
        )
    pose, trans_m = unpack_theta(np.asarray(theta, np.float64)[[0, 1, -2, -1]])
    first, second, last_but_one, last = (Rotation.from_rotvec(frame) for frame in pose)
    places = np.asarray(trans_m + root_joint_m, np.float64)
    turn_rad, next_m = _turn_rad(first, last), places[-1]
    dropped = _same(first, last, turn_rad, places[-1, 1] - places[0, 1])
    if not dropped:  # the next cycle begins with a step as those before and after it
        turn_rad = turn_rad + (_turn_rad(last_but_one, last) + _turn_rad(first, second)) / 2
        after_m = _about(turn_rad).apply(places[1] - places[0])
        next_m = places[-1] + (places[-1] - places[-2] + after_m) / 2
    shift_m = next_m - _about(turn_rad).apply(places[0])
    shift_m[1] = 0.0  # or a thousand cycles would climb
    kept = np.asarray(theta[:-1] if dropped else theta)
    cycle = Loop(kept, dropped, turn_rad, shift_m, np.asarray(root_joint_m, np.float64))
    _check_seam(cycle)
    return cycle


def _same(first: Rotation, last: Rotation, turn_rad: float, climbed_m: float) -> bool:
    """Whether joint rotations (22) are the first ones, but for place and heading of the root."""
    turns = np.zeros((len(first), 3))
    turns[0, 1] = turn_rad
    apart = (Rotation.from_rotvec(turns) * first).inv() * last
    return bool(np.degrees(apart.magnitude()).max() < _SAME_DEG and abs(climbed_m) < _SAME_M)


def _about(turn_rad: float) -> Rotation:
    return Rotation.from_rotvec([0.0, turn_rad, 0.0])


def _turn_rad(start: Rotation, end: Rotation) -> float:
    """About the vertical, from one frame's root to another's."""
    _, y, _, w = (end[0] * start[0].inv()).as_quat()
    return float(np.remainder(2 * np.arctan2(y, w) + np.pi, 2 * np.pi) - np.pi)


def _check_seam(cycle: Loop) -> None:
    within_deg, within_m = _changes(cycle.theta)
    frames = len(cycle.theta)
    across_deg, across_m = _changes(cycle.repeated(2)[frames - 2 : frames + 2])
    allowed_deg = np.maximum(within_deg.max(axis=0), SMOOTH_DEG)
    allowed_m = max(within_m.max(), SMOOTH_M)
    worst = int((across_deg.max(axis=0) - allowed_deg).argmax())
    if (jerk := across_deg[:, worst].max()) > allowed_deg[worst]:
        what, size = SMPL_JOINT_NAMES[worst], f"{jerk:.1f} degrees"
        allowed = f"{allowed_deg[worst]:.1f}"
    elif across_m.max() > allowed_m:
        what, size, allowed = "root", f"{100 * across_m.max():.1f} cm", f"{100 * allowed_m:.1f}"
    else:
        return
    raise DsnetError(
        f"--loop with a motion whose {what} jerks by {size} from the last frame to the first",
        f"at most {allowed}, as within the motion",
        REMEDY,
    )


def _changes(theta: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """By how much steps change from one frame to the next: of joints (T - 2, 22), degrees, and of
    the translation (T - 2,), metres."""
    pose, trans_m = unpack_theta(theta)
    before, after = (Rotation.from_rotvec(part.reshape(-1, 3)) for part in (pose[:-1], pose[1:]))
    steps = (before.inv() * after).as_rotvec().reshape(len(pose) - 1, -1, 3)
    changes_deg = np.degrees(np.linalg.norm(np.diff(steps, axis=0), axis=-1))
    return changes_deg, np.linalg.norm(np.diff(trans_m, 2, axis=0), axis=-1)
