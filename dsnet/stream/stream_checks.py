"""Checks of a stream's poses and betas, and warnings about suspicious poses."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.body import BodyModelData
from bridge.errors import DsnetError, notify
from bridge.motion import unpack_theta
from bridge.motion.cuts import repeated_frames
from bridge.motion.motion import FARTHEST_M, LARGEST_ANGLE_RAD
from bridge.paper import N_BETAS, THETA_SIZE
from dsnet.prediction.moving_body import LARGEST_BODY_M

_LARGEST_LIMB_RAD = 4 * np.pi
"""Largest angle of a joint below the root; angles in degrees exceed it in almost every pose."""
_CUTS_IN_A_ROW = 10
"""Consecutive cuts that are warned about: no recording has so many."""
_POSES_CHECKED, _MOST_REPEATS = 40, 8
"""Poses that are checked at a time, and repeats among them that are warned about."""


@dataclass
class PoseWarnings:
    """Warns on stderr about one character's poses that are valid one by one, but not together."""

    cuts: int = 0
    """Consecutive cuts so far."""
    poses: list[NDArray] = field(default_factory=list)
    """The newest poses (69,), until repeats are found."""
    repeats: bool = False
    """Whether repeats were found; they are warned about once."""

    def check_cut(self, is_cut: bool) -> None:
        """Warn if there was a cut before each of many frames."""
        self.cuts = self.cuts + 1 if is_cut else 0
        if self.cuts == _CUTS_IN_A_ROW:
            notify(
                f"a streamed body jumps in each of {_CUTS_IN_A_ROW} frames, so no tissue moves: "
                "are its translations in metres, and all poses of one character?"
            )

    def check_repeats(self, theta: NDArray, fps: float) -> None:
        """Warn if many poses (69,) repeat the one before while the body moves."""
        if self.repeats:
            return
        self.poses.append(theta)
        if len(self.poses) == _POSES_CHECKED:
            count = int(repeated_frames(np.stack(self.poses), fps).sum())
            self.poses, self.repeats = [], count >= _MOST_REPEATS
            if self.repeats:
                notify(
                    f"a streamed body repeats {count} of {_POSES_CHECKED} poses while it moves, "
                    "which jolts the tissue: pass each once, with fps= their rate"
                )


def finite_numbers(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """`values` as an array; `DsnetError` names them `name` if they are not finite numbers."""
    try:
        given = np.asarray(values)
        flaw = f"values of type {given.dtype}" if given.dtype.kind not in "iuf" else ""
    except (TypeError, ValueError) as error:
        given, flaw = np.empty(0), f"rows that fit no array ({error})"
    if flaw:
        raise DsnetError(f"{name} with {flaw}", "an array of numbers", "Pass finite real numbers.")
    array = given.astype(np.float64)
    if not np.isfinite(array).all():
        raise DsnetError(
            f"{name} with {int((~np.isfinite(array)).sum())} of {array.size} numbers not finite",
            "finite numbers",
            "Leave the frame out or repeat the last one; nothing has moved.",
        )
    return array


def check_poses(name: str, theta: NDArray[np.float64]) -> None:
    """Refuse poses theta (B, 69) with impossible angles or translations."""
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


def checked_pose(name: str, theta: ArrayLike) -> NDArray[np.float64]:
    """One character's pose (69,), or `DsnetError`."""
    pose = finite_numbers(name, theta)
    if pose.shape != (THETA_SIZE,):
        raise DsnetError(
            f"{name} of shape {pose.shape}",
            f"({THETA_SIZE},): {THETA_SIZE - 3} of pose and 3 of translation",
            "Pack it with bridge.motion.pack_theta.",
        )
    check_poses(name, pose[None])
    return pose


def checked_betas(betas: ArrayLike, body: BodyModelData) -> NDArray[np.float64]:
    """One character's betas (S,), missing ones 0; `DsnetError` if the body would be too large."""
    shape, count = finite_numbers("betas", betas), body.shapedirs.shape[-1]
    if shape.ndim != 1 or not N_BETAS <= len(shape) <= count:
        expected = f"({N_BETAS},)" + (f" to ({count},)" if count > N_BETAS else "")
        raise DsnetError(f"betas of shape {shape.shape}", expected, "Pass one character's betas.")
    shape = np.pad(shape, (0, count - len(shape)))
    with np.errstate(over="ignore", invalid="ignore"):
        size_m = np.ptp(body.v_template + body.shapedirs @ shape, axis=0).max()
    if not size_m < LARGEST_BODY_M:
        raise DsnetError(
            f"betas of a body of {size_m:.3g} m",
            f"one of less than {LARGEST_BODY_M:g} m",
            "Pass betas within a few standard deviations of 0.",
        )
    return shape
