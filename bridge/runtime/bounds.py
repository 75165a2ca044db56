"""What is no pose, place or shape of a person: refused before anything is computed from it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.body import BodyModelData
from bridge.errors import DsnetError
from bridge.motion import unpack_theta
from bridge.motion.motion import FARTHEST_M, LARGEST_ANGLE_RAD, LARGEST_BETA
from bridge.paper import N_BETAS, THETA_SIZE

LARGEST_BODY_M = 10.0
"""A shape larger than this is no person's."""


def numbers(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """An array of finite numbers of what a user passed as `name`.

    Raises
    ------
    DsnetError
        If it holds anything else.
    """
    try:
        found = np.asarray(values)
    except (TypeError, ValueError) as error:
        raise _no_numbers(name, f"rows that fit no array ({error})") from error
    if found.dtype.kind not in "iuf":
        raise _no_numbers(name, f"values of type {found.dtype}")
    array = found.astype(np.float64)
    if not np.isfinite(array).all():
        raise DsnetError(
            f"{name} with {int((~np.isfinite(array)).sum())} of {array.size} numbers not finite",
            "finite numbers",
            "Leave the frame out or repeat the last one; nothing has moved.",
        )
    return array


def _no_numbers(name: str, flaw: str) -> DsnetError:
    return DsnetError(f"{name} with {flaw}", "an array of numbers", "Pass finite real numbers.")


def check_poses(name: str, theta: NDArray[np.float64]) -> None:
    """Refuse poses theta (B, 69) of finite numbers that no body takes.

    Raises
    ------
    DsnetError
        If a joint's angle or the translation is beyond all bounds.
    """
    pose, trans_m = unpack_theta(theta)
    angle_rad = np.linalg.norm(pose, axis=-1).max(initial=0.0)
    far_m = np.abs(trans_m).max(initial=0.0)
    if angle_rad > LARGEST_ANGLE_RAD or far_m > FARTHEST_M:
        raise DsnetError(
            f"{name} with a joint turned by {angle_rad:.3g} rad, {far_m:.3g} m off",
            f"at most {LARGEST_ANGLE_RAD:g} rad and {FARTHEST_M:g} m",
            "Angles are in radians and translations in metres; nothing has moved.",
        )


def checked_pose(name: str, theta: ArrayLike) -> NDArray[np.float64]:
    """One person's pose (69,), as finite numbers within those bounds.

    Raises
    ------
    DsnetError
        If it is anything else.
    """
    found = numbers(name, theta)
    if found.shape != (THETA_SIZE,):
        raise DsnetError(
            f"{name} of shape {found.shape}",
            f"({THETA_SIZE},): {THETA_SIZE - 3} of pose and 3 of translation",
            "Pack it with bridge.motion.pack_theta.",
        )
    check_poses(name, found[None])
    return found


def check_shapes(name: str, betas: NDArray[np.float64]) -> None:
    """Refuse shapes (B, 10) of finite numbers that are nobody's, of whatever body model.

    Raises
    ------
    DsnetError
        If a coefficient is beyond all bounds.
    """
    largest = np.abs(betas).max(initial=0.0)
    if largest > LARGEST_BETA:
        raise DsnetError(
            f"{name} with a coefficient of {largest:.3g}",
            f"at most {LARGEST_BETA:g}",
            "Pass betas within a few standard deviations of 0; nothing has moved.",
        )


def checked_betas(betas: ArrayLike, body: BodyModelData) -> NDArray[np.float64]:
    """One person's shape (10,), whose body is of a person's size.

    Raises
    ------
    DsnetError
        If it is anything else.
    """
    found = numbers("betas", betas)
    if found.shape != (N_BETAS,):
        raise DsnetError(f"betas of shape {found.shape}", f"({N_BETAS},)", "Pass one person's.")
    with np.errstate(over="ignore", invalid="ignore"):
        size_m = np.ptp(body.v_template + body.shapedirs @ found, axis=0).max()
    if not size_m < LARGEST_BODY_M:
        raise DsnetError(
            f"betas of a body of {size_m:.3g} m",
            f"one of less than {LARGEST_BODY_M:g} m",
            "Pass betas within a few standard deviations of 0.",
        )
    return found
