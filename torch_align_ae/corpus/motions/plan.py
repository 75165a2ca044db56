"""What a motion asks of a body, before any body's proportions enter, and how it is planned."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BPoly
from scipy.spatial.transform import Rotation

Array = NDArray[np.floating]
Part = TypeVar("Part")
GRAVITY_M_S2 = 9.81
BEGIN_S = 0.2
"""Until then a body stands still."""
RELAXED_LOWER = 1.12
_COLLAR_SHARE = 0.12
_SPINE = ("spine1", "spine2", "spine3")


@dataclass(frozen=True, eq=False)
class FootPath:
    """One foot over T frames, led by its ball: what touches the floor last and first."""

    ball_m: Array
    """(T, 3) displacement of the ball of the foot from where it stands; y = 0 is contact."""
    pitch: Array
    """(T,) toes-down angle of the foot, radians. A leg that is too short raises it further."""
    yaw: Array | float = 0.0  # (T,) toes-left angle of the foot, radians
    heading: Array | float = 0.0
    """(T,) turn of the foot and of the place where it stands about the body's starting place."""


@dataclass(frozen=True, eq=False)
class BodyPlan:
    """A motion over T frames: y up, z forward, x to the body's left; the floor is y = 0."""

    pelvis_m: Array  # (T, 3) displacement of the pelvis from where it stands, metres
    pelvis_turn: Array  # (T, 3) orientation of the pelvis as an axis-angle vector, radians
    left_foot: FootPath
    right_foot: FootPath
    joints: Mapping[str, Array]  # (T, 3) axis-angle rotations of joints above the pelvis
    heading: Array | float = 0.0
    """(T,) where the body faces, radians to its left of +z; `pelvis_turn` is relative to it."""
    carried: Array | None = None
    """(T,) from 0, the feet carry the body, to 1, its lowest skin lies on the floor."""


@dataclass(frozen=True)
class Contact:
    """A stretch of time in which the ball of a foot does not move."""

    start_s: float  # landing
    stop_s: float  # take-off
    x_m: float = 0.0  # where it stands: displacement to the left of its usual place
    z_m: float = 0.0  # displacement to the front

    @property
    def middle_s(self) -> float:
        return (self.start_s + self.stop_s) / 2


def contacts_between(
    take_offs_s: ArrayLike, landings_s: ArrayLike, x_m: ArrayLike = 0.0, z_m: ArrayLike = 0.0
) -> list[Contact]:
    """Contacts before the first of these flights and after each; places may be one each."""
    starts = np.concatenate([[-1.0], landings_s])
    stops = np.concatenate([take_offs_s, [np.inf]])
    return [Contact(*row) for row in np.broadcast(starts, stops, x_m, z_m)]


@dataclass(frozen=True)
class Swing:
    """How a foot travels from one contact to the next; angles toes-down, radians."""

    lift_m: float  # height of the ball of the foot halfway
    back_m: float = 0.0  # how far it goes to the rear halfway
    take_off_pitch: float = 0.6
    pitch: float = 0.5  # halfway
    landing_pitch: float = 0.4
    standing_pitch: float = 0.0  # in the middle of a contact


def by_side(side: int, own: Part, other: Part) -> tuple[Part, Part]:
    """The left's and the right's, of which the one on `side`, +1 for the left, is `own`."""
    return (own, other) if side == 1 else (other, own)


@dataclass(frozen=True, eq=False)
class Planner:
    """What one subject plans one motion with: curves over T times and postures, in its style.

    `drawn` from the subject's and the motion's names, a style is independent of which others are.
    """

    times_s: Array  # (T,)
    size: float  # leg length relative to an average leg of 0.85 m
    entropy: tuple[int, int, int]  # seed of the small differences from one repetition to the next
    amplitude: float  # factor on heights and angles, near 1
    tempo: float  # factor on the rate of repetition, near 1
    phase: float  # where in the cycle the motion begins, radians
    leading_side: int  # +1 where the left side leads, -1 where the right does

    @classmethod
    def drawn(cls, subject: str, motion: str, times_s: Array, size: float, seed: int) -> Planner:
        entropy = (seed, zlib.crc32(subject.encode()), zlib.crc32(motion.encode()))
        rng = np.random.default_rng((*entropy, 1))
        return cls(
            times_s,
            size,
            entropy,
            amplitude=float(rng.uniform(0.88, 1.12)),
            tempo=float(rng.uniform(0.9, 1.1)),
            phase=float(rng.uniform(0, 2 * np.pi)),
            leading_side=int(rng.choice((-1, 1))),
        )

    def rng(self) -> np.random.Generator:
        """A fresh generator, so that the same style always gives the same motion."""
        return np.random.default_rng(self.entropy)

    def starts_s(self, begin_s: float, period_s: float) -> Array:
        """When what is repeated begins again, until after the last of the times."""
        return np.arange(begin_s, self.times_s[-1] + 1.0, period_s)

    def sides(self, starts_s: Array) -> NDArray[np.integer]:
        """Whose turn it is at each of these: the leading side first, +1 for the left."""
        return self.leading_side * (-1) ** np.arange(len(starts_s))

    def zeros(self) -> Array:
        return np.zeros(self.times_s.shape)

    def repeated(self, starts_s: Iterable[float], moments_s: Array, values: ArrayLike) -> Array:
        """Keyframes that begin again and again."""
        return sum((self.keyframes(at_s + moments_s, values) for at_s in starts_s), self.zeros())

    def ease(self, start_s: float, stop_s: float) -> Array:
        """0 before `start_s`, 1 after `stop_s`, and twice differentiable between."""
        s = np.clip((self.times_s - start_s) / (stop_s - start_s), 0.0, 1.0)
        return s**3 * (10 - 15 * s + 6 * s**2)

    def keyframes(self, knots_s: ArrayLike, values: ArrayLike) -> Array:
        """Pass through `values` at `knots_s`, at rest in each, and hold the first and the last."""
        knots_s, values = np.asarray(knots_s, np.float64), np.asarray(values, np.float64)
        result = np.full(self.times_s.shape, values[0])
        for start_s, stop_s, change in zip(knots_s[:-1], knots_s[1:], np.diff(values), strict=True):
            result += change * self.ease(start_s, stop_s)
        return result

    def track(self, knots: Sequence[tuple[float, float, float, float]]) -> Array:
        """Quintic pieces through knots (time s, value, velocity, acceleration), held outside them.

        Two knots of a ballistic flight give exactly its parabola.
        """
        table = np.asarray(knots, np.float64)
        curve = BPoly.from_derivatives(table[:, 0], table[:, 1:])
        return np.asarray(curve(np.clip(self.times_s, table[0, 0], table[-1, 0])), np.float64)

    def bump(self, start_s: float, stop_s: float) -> Array:
        """0 outside, 1 halfway, and twice differentiable: (4 s (1 - s))^3."""
        s = np.clip((self.times_s - start_s) / (stop_s - start_s), 0.0, 1.0)
        return (4 * s * (1 - s)) ** 3

    def cycle(self, rate_hz: float, begin_s: float) -> Array:
        """Phase of a periodic motion that stands still until `begin_s` and speeds up over 0.3 s."""
        ramp_s = 0.3
        after_s = np.clip(self.times_s - begin_s, 0.0, None)
        s = np.minimum(after_s / ramp_s, 1.0)
        # The integral of a smoothstep: phase, rate and the rate's rate begin at zero.
        travelled_s = ramp_s * (s**3 - s**4 / 2) + np.maximum(after_s - ramp_s, 0.0)
        return 2 * np.pi * rate_hz * travelled_s

    def axis(self, x: ArrayLike = 0.0, y: ArrayLike = 0.0, z: ArrayLike = 0.0) -> Array:
        """(T, 3) from three curves or constants."""
        return np.stack([np.broadcast_to(part, self.times_s.shape) for part in (x, y, z)], axis=1)

    def body(
        self,
        pelvis_m: Array,
        pelvis_turn: Array,
        feet: tuple[FootPath, FootPath] | None = None,
        *,
        spine: tuple[ArrayLike, ArrayLike, ArrayLike],
        heading: Array | float = 0.0,
        carried: Array | None = None,
        **arms: ArrayLike | tuple[ArrayLike, ArrayLike],
    ) -> BodyPlan:
        """A body, on both feet in their places if their paths are not given.

        `spine` is its forward bend, left turn and roll, spread over three joints; the head undoes
        half of them. `arms` are angles as in `_arm`, of both alike, or the left's and the right's.
        """
        whole = self.axis(*spine)
        joints = {name: whole / len(_SPINE) for name in _SPINE}
        joints |= {"neck": -whole / 4, "head": -whole / 4}
        for row, side in enumerate(("left", "right")):
            own = {name: a[row] if isinstance(a, tuple) else a for name, a in arms.items()}
            joints |= self._arm(side, **own)
        planted = self.standing_foot()
        left, right = feet or (planted, planted)
        return BodyPlan(pelvis_m, pelvis_turn, left, right, joints, heading, carried)

    def _arm(
        self,
        side: str,
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
            np.broadcast_to(np.asarray(value, np.float64), self.times_s.shape)
            for value in (lower, swing, twist, elbow, shrug)
        )
        collar = Rotation.from_euler("Z", shrug - _COLLAR_SHARE * lower)
        whole = Rotation.from_euler("XZX", np.stack([-swing, -lower, twist], axis=1))
        left = {
            "collar": collar.as_rotvec(),
            "shoulder": (collar.inv() * whole).as_rotvec(),
            "elbow": self.axis(y=-elbow),
        }
        mirror = (1.0, 1.0, 1.0) if side == "left" else (1.0, -1.0, -1.0)
        return {f"{side}_{joint}": rotation * mirror for joint, rotation in left.items()}

    def standing_foot(self, pitch: Array | float = 0.0) -> FootPath:
        """A foot that stays in its place."""
        return FootPath(self.axis(), self.zeros() + pitch)

    def stepping_foot(self, contacts: Sequence[Contact], swings: Sequence[Swing]) -> FootPath:
        """A foot that stands during `contacts`, the first from the start, and swings between."""
        x, z, y = (self.zeros() for _ in range(3))
        x, z = x + contacts[0].x_m, z + contacts[0].z_m
        pitch_knots = [(contacts[0].start_s, 0.0)]
        for before, after, swing in zip(contacts[:-1], contacts[1:], swings, strict=True):
            travel = self.ease(before.stop_s, after.start_s)
            # Steeper at its ends than `bump`, so that the foot keeps up with a body that takes off.
            s = np.clip((self.times_s - before.stop_s) / (after.start_s - before.stop_s), 0.0, 1.0)
            arch = (4 * s * (1 - s)) ** 2
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
        pitch = self.keyframes(*zip(*pitch_knots, strict=True))
        return FootPath(self.axis(x, y, z), pitch)
