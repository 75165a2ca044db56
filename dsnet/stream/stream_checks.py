"""What a stream refuses, poses and shapes of no person, and what of her poses it tells."""

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
"""No limb turns twice about itself; in degrees one does in almost every pose."""
_LEAPS_IN_A_ROW = 10
"""No recording has so many: something else is wrong with the poses."""
_HEARD, _REPEATED = 40, 8
"""Of so many poses, how many that repeat the one before are told of."""


@dataclass
class Oddities:
    """Of one person's poses, each of which somebody could take; told of once on stderr."""

    leaps: int = 0
    """From each of so many frames to the next."""
    heard: list[NDArray] = field(default_factory=list)
    """The newest poses (69,), until enough of them repeat."""
    repeats: bool = False

    def leap(self, leaps: bool) -> None:
        """Of a frame that may be a cut away from the one before."""
        self.leaps = self.leaps + 1 if leaps else 0
        if self.leaps == _LEAPS_IN_A_ROW:
            notify(
                f"a streamed body leaps from each of {_LEAPS_IN_A_ROW} frames to the next, so "
                "no tissue moves: are its translations in metres, and every pose hers?"
            )

    def hear(self, theta: NDArray, fps: float) -> None:
        """Of a pose (69,) as it comes."""
        if self.repeats:
            return
        self.heard.append(theta)
        if len(self.heard) == _HEARD:
            again = int(repeated_frames(np.stack(self.heard), fps).sum())
            self.heard, self.repeats = [], again >= _REPEATED
            if self.repeats:
                notify(
                    f"a streamed body repeats {again} of {_HEARD} poses while she moves, which "
                    "jolts the tissue: pass each once, with fps= their rate"
                )


def finite_numbers(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """An array of finite numbers of what a user passed as `name`."""
    try:
        found = np.asarray(values)
        flaw = f"values of type {found.dtype}" if found.dtype.kind not in "iuf" else ""
    except (TypeError, ValueError) as error:
        found, flaw = np.empty(0), f"rows that fit no array ({error})"
    if flaw:
        raise DsnetError(f"{name} with {flaw}", "an array of numbers", "Pass finite real numbers.")
    array = found.astype(np.float64)
    if not np.isfinite(array).all():
        raise DsnetError(
            f"{name} with {int((~np.isfinite(array)).sum())} of {array.size} numbers not finite",
            "finite numbers",
            "Leave the frame out or repeat the last one; nothing has moved.",
        )
    return array


def check_poses(name: str, theta: NDArray[np.float64]) -> None:
    """Refuse poses theta (B, 69) of finite numbers that no body takes."""
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
    """One person's pose (69,)."""
    found = finite_numbers(name, theta)
    if found.shape != (THETA_SIZE,):
        raise DsnetError(
            f"{name} of shape {found.shape}",
            f"({THETA_SIZE},): {THETA_SIZE - 3} of pose and 3 of translation",
            "Pack it with bridge.motion.pack_theta.",
        )
    check_poses(name, found[None])
    return found


def checked_betas(betas: ArrayLike, body: BodyModelData) -> NDArray[np.float64]:
    """One person's shape (S,), whose body is of a person's size; what is not given is 0."""
    found, count = finite_numbers("betas", betas), body.shapedirs.shape[-1]
    if found.ndim != 1 or not N_BETAS <= len(found) <= count:
        expected = f"({N_BETAS},)" + (f" to ({count},)" if count > N_BETAS else "")
        raise DsnetError(f"betas of shape {found.shape}", expected, "Pass one person's.")
    found = np.pad(found, (0, count - len(found)))
    with np.errstate(over="ignore", invalid="ignore"):
        size_m = np.ptp(body.v_template + body.shapedirs @ found, axis=0).max()
    if not size_m < LARGEST_BODY_M:
        raise DsnetError(
            f"betas of a body of {size_m:.3g} m",
            f"one of less than {LARGEST_BODY_M:g} m",
            "Pass betas within a few standard deviations of 0.",
        )
    return found
