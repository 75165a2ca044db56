"""Two-link legs in closed form: hip, knee, ankle and toe rotations that put a foot in its place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from torch_align_ae.corpus.motions.plan import Array, FootPath

# A leg is never stretched beyond this share of its length: at 1 the knee's speed is unbounded.
_STRETCH = 0.993
# Below this toes-down angle a heel leaves the floor gradually instead of at once, radians.
_HEEL_SOFTNESS = np.deg2rad(2.0)
_PITCH_RANGE = (-0.9, 1.35)
_TOES_FLAT_BELOW_M = 0.04


@dataclass(frozen=True, eq=False)
class Leg:
    """One leg of a body in its rest pose; joints (3,) in metres, relative to the floor."""

    hip_m: Array
    """Hip joint."""
    knee_m: Array
    """Knee joint."""
    ankle_m: Array
    """Ankle joint."""
    ball_m: Array
    """Ball of the foot: SMPL's `foot` joint."""

    @property
    def reach_m(self) -> float:
        """Greatest planned distance from hip to ankle."""
        thigh, calf = self.knee_m - self.hip_m, self.ankle_m - self.knee_m
        return _STRETCH * float(np.linalg.norm(thigh) + np.linalg.norm(calf))


@dataclass(frozen=True, eq=False)
class LegPose:
    """Axis-angle rotations (T, 3) of the four joints of a leg."""

    hip: Array
    knee: Array
    ankle: Array
    toes: Array


def pose_leg(
    leg: Leg,
    pelvis_turn: Rotation,
    hip_m: Array,
    foot: FootPath,
    ball_m: Array,
    heading: Array | float = 0.0,
) -> LegPose:
    """Rotations that bring the ball of the foot to `ball_m` (T, 3).

    Parameters
    ----------
    leg : rest pose of this leg.
    pelvis_turn : T orientations of the pelvis.
    hip_m : (T, 3) hip joint in the world, metres.
    foot : pitch and yaw that the motion asks for.
    ball_m : (T, 3) ball of the foot in the world, metres.
    heading : (T,) where the body faces, radians.
    """
    pitch = _raise_heel(leg, hip_m, foot, ball_m)
    foot_turn = _foot_turn(pitch, foot.yaw + foot.heading)
    ankle_m = ball_m + foot_turn.apply(leg.ankle_m - leg.ball_m)
    target = pelvis_turn.inv().apply(ankle_m - hip_m)
    splay = Rotation.from_rotvec(np.outer(foot.yaw + foot.heading - heading, (0.0, 1.0, 0.0)))
    knee_angle = _knee_angle(leg, np.linalg.norm(target, axis=1))
    knee = Rotation.from_rotvec(np.outer(knee_angle, (1.0, 0.0, 0.0)))
    hip = _aim(leg, knee, target, splay.apply((1.0, 0.0, 0.0)))
    ankle = (pelvis_turn * hip * knee).inv() * foot_turn
    height_m = np.maximum(ball_m[:, 1] - leg.ball_m[1], 0.0)
    flat = 1 / (1 + (height_m / _TOES_FLAT_BELOW_M) ** 2)
    toes = np.outer(-pitch * flat, (1.0, 0.0, 0.0))
    return LegPose(hip.as_rotvec(), knee.as_rotvec(), ankle.as_rotvec(), toes)


def _foot_turn(pitch: Array, yaw: Array) -> Rotation:
    return Rotation.from_euler("YX", np.stack([yaw, pitch], axis=1))


def _raise_heel(leg: Leg, hip_m: Array, foot: FootPath, ball_m: Array) -> Array:
    """The asked-for pitch, or as much more as lets the leg reach: a smooth maximum of the two."""
    low, high = (np.full(foot.pitch.shape, bound) for bound in _PITCH_RANGE)
    heel, yaw = leg.ankle_m - leg.ball_m, foot.yaw + foot.heading
    for _ in range(40):
        middle = (low + high) / 2
        ankle_m = ball_m + _foot_turn(middle, yaw).apply(heel)
        too_far = np.linalg.norm(ankle_m - hip_m, axis=1) > leg.reach_m
        low, high = np.where(too_far, middle, low), np.where(too_far, high, middle)
    return _HEEL_SOFTNESS * np.logaddexp(foot.pitch / _HEEL_SOFTNESS, high / _HEEL_SOFTNESS)


def _knee_angle(leg: Leg, distance_m: Array) -> Array:
    """Flexion about x that puts the ankle at `distance_m` from the hip (law of cosines)."""
    thigh, calf = leg.knee_m - leg.hip_m, leg.ankle_m - leg.knee_m
    cosine = thigh[1] * calf[1] + thigh[2] * calf[2]
    sine = thigh[2] * calf[1] - thigh[1] * calf[2]
    along = (distance_m**2 - thigh @ thigh - calf @ calf) / 2 - thigh[0] * calf[0]
    return np.arctan2(sine, cosine) + np.arccos(np.clip(along / np.hypot(sine, cosine), -1, 1))


def _aim(leg: Leg, knee: Rotation, target: Array, lateral: Array) -> Rotation:
    """Hip rotation that points the bent leg at `target` and its knee axis along `lateral`."""
    thigh, calf = leg.knee_m - leg.hip_m, leg.ankle_m - leg.knee_m
    rest = _frame(thigh + knee.apply(calf), np.broadcast_to((1.0, 0.0, 0.0), target.shape))
    return Rotation.from_matrix(_frame(target, lateral) @ rest.swapaxes(1, 2))


def _frame(along: Array, lateral: Array) -> Array:
    """(T, 3, 3) with columns: direction of the leg, knee axis, and their cross product."""
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    lateral = lateral - (lateral * along).sum(1, keepdims=True) * along
    lateral = lateral / np.linalg.norm(lateral, axis=1, keepdims=True)
    return np.stack([along, lateral, np.cross(along, lateral)], axis=2)
