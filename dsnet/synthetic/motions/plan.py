"""Plans of motions, which do not depend on the proportions of a body, and curves to make them."""

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
Joints = dict[str, Array]
"""(T, 3) axis-angle rotations of joints above the pelvis."""
Part = TypeVar("Part")
GRAVITY_M_S2 = 9.81
BEGIN_S = 0.2
"""Time until which a body stands still."""
RELAXED_LOWER = 1.12
_COLLAR_SHARE = 0.12


@dataclass(frozen=True, eq=False)
class FootPath:
    """One foot over T frames, by the path of its ball, which leaves the floor last.

    Without arguments it stays in its place.
    """

    ball_m: Array | float = 0.0
    """(T, 3) displacement of the ball of the foot from where it stands; y = 0 is contact."""
    pitch: Array | float = 0.0
    """(T,) toes-down angle of the foot, radians. A leg that is too short raises it further."""
    yaw: Array | float = 0.0  # (T,) toes-left angle of the foot, radians
    heading: Array | float = 0.0
    """(T,) rotation of the foot and of its position about the body's initial position, radians."""


@dataclass(frozen=True, eq=False)
class BodyPlan:
    """A motion over T frames: y up, z forward, x to the body's left; the floor is y = 0."""

    pelvis_m: Array  # (T, 3) displacement of the pelvis from where it stands, metres
    pelvis_turn: Array  # (T, 3) orientation of the pelvis as an axis-angle vector, radians
    joints: Mapping[str, Array]
    feet: tuple[FootPath, FootPath] = (FootPath(), FootPath())  # the left one and the right one
    heading: Array | float = 0.0
    """(T,) where the body faces, radians to its left of +z; `pelvis_turn` is relative to it."""
    on_floor: Array | None = None
    """(T,) 0 if the body stands on its feet, 1 if its lowest skin lies on the floor."""


@dataclass(frozen=True)
class Step:
    """How a foot leaves the floor and lands; angles toes-down, radians."""

    start_s: float  # take-off
    stop_s: float  # landing
    lift_m: float  # height of the ball of the foot halfway
    x_m: float = 0.0  # where it lands: displacement from its first place, to the body's first left
    z_m: float = 0.0  # to its first front
    heading: float = 0.0  # turn of its place and of the foot, radians to the left
    side: int = 0  # +1 the left foot's, -1 the right's
    back_m: float = 0.0  # how far it goes to the rear halfway
    take_off_pitch: float = 0.6
    pitch: float = 0.5  # halfway
    landing_pitch: float = 0.4
    standing_pitch: float = 0.0  # in the middle of the contacts before and after


def by_side(side: int, own: Part, other: Part) -> tuple[Part, Part]:
    """A pair for left and right, with `own` on `side`, which is +1 for the left."""
    return (own, other) if side == 1 else (other, own)


@dataclass(frozen=True, eq=False)
class Planner:
    """Makes curves over T times and postures in the style of one subject and motion.

    The style is `drawn` by the names of both, so it does not depend on other motions.
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
        amplitude, tempo = float(rng.uniform(0.88, 1.12)), float(rng.uniform(0.9, 1.1))
        phase, leading_side = float(rng.uniform(0, 2 * np.pi)), int(rng.choice((-1, 1)))
        return cls(times_s, size, entropy, amplitude, tempo, phase, leading_side)

    def rng(self) -> np.random.Generator:
        """A new generator with the same seed, so that a style always gives the same motion."""
        return np.random.default_rng(self.entropy)

    def starts_s(self, begin_s: float, period_s: float) -> Array:
        """Start times of repetitions, until after the last of the times."""
        return np.arange(begin_s, self.times_s[-1] + 1.0, period_s)

    def sides(self, starts_s: Array) -> NDArray[np.integer]:
        """The side at each of these, in turn from the leading side; +1 is the left."""
        return self.leading_side * (-1) ** np.arange(len(starts_s))

    def zeros(self) -> Array:
        return np.zeros(self.times_s.shape)

    def share(self, start_s: float, stop_s: float) -> Array:
        """0 until `start_s`, 1 from `stop_s` on, and linear between."""
        return np.clip((self.times_s - start_s) / (stop_s - start_s), 0.0, 1.0)

    def ease(self, start_s: float, stop_s: float) -> Array:
        """0 before `start_s`, 1 after `stop_s`, and twice differentiable between."""
        s = self.share(start_s, stop_s)
        return s**3 * (10 - 15 * s + 6 * s**2)

    def bump(self, start_s: float, stop_s: float) -> Array:
        """0 outside, 1 halfway, and twice differentiable: (4 s (1 - s))^3."""
        s = self.share(start_s, stop_s)
        return (4 * s * (1 - s)) ** 3

    def keyframes(self, knots_s: ArrayLike, values: ArrayLike) -> Array:
        """Pass through `values` at `knots_s`, at rest in each, and hold the first and the last."""
        knots_s, values = np.asarray(knots_s, np.float64), np.asarray(values, np.float64)
        result = np.full(self.times_s.shape, values[0])
        for start_s, stop_s, change in zip(knots_s[:-1], knots_s[1:], np.diff(values), strict=True):
            result += change * self.ease(start_s, stop_s)
        return result

    def repeated(self, starts_s: Iterable[float], moments_s: Array, values: ArrayLike) -> Array:
        """Keyframes that are repeated from each of the start times."""
        return sum((self.keyframes(at_s + moments_s, values) for at_s in starts_s), self.zeros())

    def track(self, knots: Sequence[Sequence[float]]) -> Array:
        """Quintic pieces through knots (time s, value, velocity, acceleration), held outside them.

        Two knots of a ballistic flight give exactly its parabola.
        """
        table = np.asarray(knots, np.float64)
        curve = BPoly.from_derivatives(table[:, 0], table[:, 1:])
        return np.asarray(curve(np.clip(self.times_s, table[0, 0], table[-1, 0])), np.float64)

    def cycle(self, rate_hz: float, begin_s: float) -> Array:
        """Phase of a periodic motion that stands still until `begin_s` and speeds up over 0.3 s."""
        ramp_s = 0.3
        after_s = np.clip(self.times_s - begin_s, 0.0, None)
        s = np.minimum(after_s / ramp_s, 1.0)
        # The integral of a smoothstep: phase, rate and the rate's rate begin at zero.
        travelled_s = ramp_s * (s**3 - s**4 / 2) + np.maximum(after_s - ramp_s, 0.0)
        return 2 * np.pi * rate_hz * travelled_s

    def axis(self, x: ArrayLike = 0.0, y: ArrayLike = 0.0, z: ArrayLike = 0.0) -> Array:
        """Vectors (T, 3) from three curves or constants."""
        return np.stack([np.broadcast_to(part, self.times_s.shape) for part in (x, y, z)], axis=1)

    def spine(self, bend: ArrayLike, turn: ArrayLike = 0.0, roll: ArrayLike = 0.0) -> Joints:
        """Forward bend, left turn and roll, divided among three joints; the head reverses half."""
        whole = self.axis(bend, turn, roll)
        joints: Joints = {f"spine{number}": whole / 3 for number in (1, 2, 3)}
        joints["neck"] = joints["head"] = -whole / 4
        return joints

    def arms(self, **angles: ArrayLike | tuple[ArrayLike, ArrayLike]) -> Joints:
        """Angles as in `_arm`, for both arms, or as pairs for left and right."""
        pairs = {name: a if isinstance(a, tuple) else (a, a) for name, a in angles.items()}
        left, right = ({name: pair[row] for name, pair in pairs.items()} for row in (0, 1))
        return self._arm("left", **left) | self._arm("right", **right)

    def _arm(
        self,
        side: str,
        lower: ArrayLike = RELAXED_LOWER,
        swing: ArrayLike = 0.0,
        twist: ArrayLike = 0.0,
        elbow: ArrayLike = 0.25,
        shrug: ArrayLike = 0.0,
    ) -> Joints:
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
        collar = Rotation.from_euler("Z", (shrug - _COLLAR_SHARE * lower)[:, None])
        whole = Rotation.from_euler("XZX", np.stack([-swing, -lower, twist], axis=1))
        shoulder = (collar.inv() * whole).as_rotvec()
        left = {"collar": collar.as_rotvec(), "shoulder": shoulder, "elbow": self.axis(y=-elbow)}
        mirror = (1.0, 1.0, 1.0) if side == "left" else (1.0, -1.0, -1.0)
        return {f"{side}_{joint}": rotation * mirror for joint, rotation in left.items()}

    def feet(self, steps: Sequence[Step]) -> tuple[FootPath, FootPath]:
        """Paths of the left and the right foot, each through the `steps` of its side."""
        left, right = ([step for step in steps if step.side == side] for side in (1, -1))
        return self.foot(left), self.foot(right)

    def foot(self, steps: Sequence[Step]) -> FootPath:
        """The path of a foot through `steps`, between which it stands."""
        if not steps:
            return FootPath(self.axis())
        lift_m = self.zeros()
        path, position = np.zeros((len(lift_m), 3)), np.zeros(3)  # x, z, metres, and heading
        flat_s = steps[0].start_s - 0.28
        pitch_knots = [(-1.0, 0.0), (steps[0].start_s - 0.4, 0.0)]
        ends_s = [*(step.start_s for step in steps[1:]), np.inf]  # of the contact after each
        for step, end_s in zip(steps, ends_s, strict=True):
            travel, s = (f(step.start_s, step.stop_s) for f in (self.ease, self.share))
            # Steeper at its ends than `bump`, so that the foot keeps up with a body that takes off.
            arch = (4 * s * (1 - s)) ** 2
            landing = np.array([step.x_m, step.z_m, step.heading])
            path += np.outer(travel, landing - position) - np.outer(arch, (0.0, step.back_m, 0.0))
            position = landing
            lift_m += step.lift_m * arch
            middle_s = (step.stop_s + end_s) / 2
            pitch_knots += [
                (max(step.start_s - 0.16, flat_s), step.standing_pitch),
                (step.start_s, step.take_off_pitch),
                ((step.start_s + step.stop_s) / 2, step.pitch),
                (step.stop_s, step.landing_pitch),
                (min(step.stop_s + 0.12, middle_s), step.standing_pitch),
            ]
            flat_s = middle_s + 0.01
        pitch = self.keyframes(*zip(*pitch_knots, strict=True))
        x_m, z_m, heading = path.T
        return FootPath(self.axis(x_m, lift_m, z_m), pitch, heading=heading)
