"""What a motion asks of a body, before any body's proportions enter."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
GRAVITY_M_S2 = 9.81


@dataclass(frozen=True, eq=False)
class FootPath:
    """One foot over T frames, led by its ball: what touches the floor last and first."""

    ball_m: Array
    """(T, 3) displacement of the ball of the foot from where it stands; y = 0 is contact."""
    pitch: Array
    """(T,) toes-down angle of the foot, radians. A leg that is too short raises it further."""
    yaw: Array
    """(T,) toes-left angle of the foot, radians."""
    heading: Array | float = 0.0
    """(T,) turn of the foot and of the place where it stands about the body's starting place."""


@dataclass(frozen=True, eq=False)
class BodyPlan:
    """A motion over T frames: y up, z forward, x to the body's left; the floor is y = 0."""

    pelvis_m: Array
    """(T, 3) displacement of the pelvis from where it stands, metres."""
    pelvis_turn: Array
    """(T, 3) orientation of the pelvis as an axis-angle vector, radians."""
    left_foot: FootPath
    """Where the left foot shall be."""
    right_foot: FootPath
    """Where the right foot shall be."""
    joints: Mapping[str, Array] = field(default_factory=dict)
    """(T, 3) axis-angle rotation of each joint above the pelvis that is not at rest."""
    heading: Array | float = 0.0
    """(T,) where the body faces, radians to its left of +z; `pelvis_turn` is relative to it."""
    carried: Array | None = None
    """(T,) from 0, the feet carry the body, to 1, its lowest skin lies on the floor."""


@dataclass(frozen=True)
class Style:
    """How one subject performs one motion; drawn from the subject's and the motion's names."""

    amplitude: float
    """Factor on heights and angles, near 1."""
    tempo: float
    """Factor on the rate of repetition, near 1."""
    phase: float
    """Where in the cycle the motion begins, radians."""
    leading_side: int
    """+1 where the left side leads, -1 where the right does."""
    size: float
    """Leg length relative to an average leg of 0.85 m."""
    entropy: tuple[int, int, int]
    """Seed of the small differences from one repetition to the next."""

    def rng(self) -> np.random.Generator:
        """A fresh generator, so that the same style always performs the same motion."""
        return np.random.default_rng(self.entropy)


def draw_style(subject: str, motion: str, size: float, seed: int) -> Style:
    """The style of `subject` in `motion`, independent of which others are made."""
    entropy = (seed, zlib.crc32(subject.encode()), zlib.crc32(motion.encode()))
    rng = np.random.default_rng((*entropy, 1))
    return Style(
        amplitude=float(rng.uniform(0.88, 1.12)),
        tempo=float(rng.uniform(0.9, 1.1)),
        phase=float(rng.uniform(0, 2 * np.pi)),
        leading_side=int(rng.choice((-1, 1))),
        size=size,
        entropy=entropy,
    )
