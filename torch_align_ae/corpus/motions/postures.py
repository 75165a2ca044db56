"""Parts that many motions share: arms, trunk, feet that stand or step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from torch_align_ae.corpus.motions.curves import axis, ease, keyframes
from torch_align_ae.corpus.motions.plan import Array, FootPath

RELAXED_LOWER = 1.12
_COLLAR_SHARE = 0.12
_SPINE = ("spine1", "spine2", "spine3")


def arm(
    times_s: Array,
    side: str,
    *,
    lower: ArrayLike = RELAXED_LOWER,
    swing: ArrayLike = 0.0,
    twist: ArrayLike = 0.0,
    elbow: ArrayLike = 0.25,
    shrug: ArrayLike = 0.0,
) -> dict[str, Array]:
    """Collar, shoulder and elbow rotations of one arm, radians.

    Parameters
    ----------
    lower : angle below the horizontal; pi/2 hangs down, negative is above the shoulder.
    swing : then forwards about the left-right axis.
    twist : of the upper arm about its own length; negative turns a bent forearm upwards.
    elbow : flexion, forwards for a hanging arm.
    shrug : raises the collar bone without the arm's direction.
    """
    lower, swing, twist, elbow, shrug = (
        np.broadcast_to(np.asarray(value, np.float64), times_s.shape)
        for value in (lower, swing, twist, elbow, shrug)
    )
    collar = Rotation.from_euler("Z", shrug - _COLLAR_SHARE * lower)
    whole = Rotation.from_euler("XZX", np.stack([-swing, -lower, twist], axis=1))
    left = {
        "collar": collar.as_rotvec(),
        "shoulder": (collar.inv() * whole).as_rotvec(),
        "elbow": axis(times_s, y=-elbow),
    }
    mirror = (1.0, 1.0, 1.0) if side == "left" else (1.0, -1.0, -1.0)
    return {f"{side}_{joint}": rotation * mirror for joint, rotation in left.items()}


def arms(times_s: Array, **angles: ArrayLike) -> dict[str, Array]:
    """Both arms alike; keywords as in `arm`."""
    return {**arm(times_s, "left", **angles), **arm(times_s, "right", **angles)}


def trunk(
    times_s: Array, *, bend: ArrayLike = 0.0, turn: ArrayLike = 0.0, roll: ArrayLike = 0.0
) -> dict[str, Array]:
    """Spread forward bend, left turn and roll over the spine; the head undoes half of them."""
    whole = axis(times_s, bend, turn, roll)
    spine = {name: whole / len(_SPINE) for name in _SPINE}
    return {**spine, "neck": -whole / 4, "head": -whole / 4}


def standing_foot(
    times_s: Array, *, pitch: Array | float = 0.0, yaw: Array | float = 0.0
) -> FootPath:
    """A foot that stays in its place."""
    zeros = np.zeros(times_s.shape)
    return FootPath(axis(times_s), zeros + pitch, zeros + yaw)


@dataclass(frozen=True)
class Contact:
    """A stretch of time in which the ball of a foot does not move."""

    start_s: float
    """Landing."""
    stop_s: float
    """Take-off."""
    x_m: float = 0.0
    """Where it stands: displacement to the left of its usual place."""
    z_m: float = 0.0
    """Displacement to the front."""

    @property
    def middle_s(self) -> float:
        """Halfway between landing and take-off."""
        return (self.start_s + self.stop_s) / 2


def contacts_between(take_offs_s: Array, landings_s: Array) -> list[Contact]:
    """Contacts in one place, before the first of these flights and after each."""
    starts = np.concatenate([[-1.0], landings_s])
    stops = np.concatenate([take_offs_s, [np.inf]])
    return [Contact(start, stop) for start, stop in zip(starts, stops, strict=True)]


@dataclass(frozen=True)
class Swing:
    """How a foot travels from one contact to the next."""

    lift_m: float
    """Height of the ball of the foot halfway."""
    back_m: float = 0.0
    """How far it goes to the rear halfway."""
    take_off_pitch: float = 0.6
    """Toes-down angle when it leaves the floor, radians."""
    pitch: float = 0.5
    """Toes-down angle halfway."""
    landing_pitch: float = 0.4
    """Toes-down angle when it meets the floor."""
    standing_pitch: float = 0.0
    """Toes-down angle in the middle of a contact."""


def stepping_foot(
    times_s: Array,
    contacts: Sequence[Contact],
    swings: Sequence[Swing],
    *,
    yaw: Array | float = 0.0,
) -> FootPath:
    """A foot that stands during `contacts`, first from the beginning, and swings between them."""
    x, z, y = (np.zeros(times_s.shape) for _ in range(3))
    x, z = x + contacts[0].x_m, z + contacts[0].z_m
    pitch_knots = [(contacts[0].start_s, 0.0)]
    for before, after, swing in zip(contacts[:-1], contacts[1:], swings, strict=True):
        travel = ease(times_s, before.stop_s, after.start_s)
        arch = _arch(times_s, before.stop_s, after.start_s)
        x += (after.x_m - before.x_m) * travel
        z += (after.z_m - before.z_m) * travel - swing.back_m * arch
        y += swing.lift_m * arch
        flat_s = before.middle_s + 0.01
        if before is contacts[0]:
            pitch_knots.append((before.stop_s - 0.4, 0.0))
            flat_s = before.stop_s - 0.28
        pitch_knots += [
            (max(before.stop_s - 0.16, flat_s), swing.standing_pitch),
            (before.stop_s, swing.take_off_pitch),
            ((before.stop_s + after.start_s) / 2, swing.pitch),
            (after.start_s, swing.landing_pitch),
            (min(after.start_s + 0.12, after.middle_s), swing.standing_pitch),
        ]
    pitch = keyframes(times_s, *zip(*pitch_knots, strict=True))
    return FootPath(axis(times_s, x, y, z), pitch, np.zeros(times_s.shape) + yaw)


def _arch(times_s: Array, start_s: float, stop_s: float) -> Array:
    # Steeper at its ends than `bump`, so that the foot keeps up with a body that takes off.
    s = np.clip((times_s - start_s) / (stop_s - start_s), 0.0, 1.0)
    return (4 * s * (1 - s)) ** 2
