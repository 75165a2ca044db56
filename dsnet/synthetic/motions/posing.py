"""From a plan to the paper's pose vector, for the proportions of one subject.

Legs are solved in closed form: rotations of hip, knee, ankle and toes put a foot in its place. A
body that sits or lies is lowered until its skin touches the floor.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from bridge.body import BodyModelData
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.posing import ShapedBody, Smpl, shaped_vertices
from bridge.motion import pack_theta
from bridge.motion.resampling import continuous_rotations
from bridge.paper import N_JOINTS
from dsnet.synthetic.motions.plan import Array, BodyPlan

_JOINT = {name: index for index, name in enumerate(SMPL_JOINT_NAMES)}
_AVERAGE_LEG_M = 0.85
# Knees are slightly bent in standing, as straight legs could not follow any movement.
_STANDING_DROP = 0.022
# Feet stand closer than in the T-pose, whose legs are spread.
_STANCE_WIDTH = 0.55
# A leg is never stretched beyond this share of its length: at 1 the knee's speed is unbounded.
_STRETCH = 0.993
# Toes-down angle below which a heel leaves the floor gradually instead of abruptly, radians.
_HEEL_SOFTNESS = np.deg2rad(2.0)
_PITCH_RANGE = (-0.9, 1.35)
_TOES_FLAT_BELOW_M = 0.04
# Bones of trunk, head, buttocks and thighs, on whose skin a body sits and lies.
_BEARING = ("pelvis", "spine1", "spine2", "spine3", "neck", "head", "left_hip", "right_hip")
_EVERY_VERTEX = 2
_SOFTNESS_M = 0.003
# Depth by which tissue is compressed under the body's weight.
_COMPRESSED_M = 0.004
_SETTLING_ROUNDS = 3
_SIDES = ("left", "right")
_X, _Y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)


class Skeleton:
    """The body of shape `betas` (10,) in the rest pose."""

    def __init__(self, data: BodyModelData, betas: Array) -> None:
        self._data, self._betas = data, betas
        vertices = shaped_vertices(data, betas[None])[0]
        # Height of the floor under the feet in the body model's own coordinates.
        self.floor_m = float(vertices[:, 1].min())
        self.joints_m = data.J_regressor @ vertices - (0.0, self.floor_m, 0.0)  # (24, 3) above it

    @property
    def size(self) -> float:
        """Leg length relative to an average one."""
        return float(self.joints_m[_JOINT["left_hip"], 1]) / _AVERAGE_LEG_M

    @cached_property
    def bearing(self) -> ShapedBody:
        """The skin on which it sits and lies."""
        bones = [_JOINT[name] for name in _BEARING]
        chosen = np.flatnonzero(self._data.weights[:, bones].sum(1) > 0.5)[::_EVERY_VERTEX]
        return Smpl(self._data, chosen, np.float64).person(self._betas)


def pose_body(skeleton: Skeleton, plan: BodyPlan) -> Array:
    """theta (T, 69) of a subject by `plan`."""
    pose = np.zeros((len(plan.pelvis_m), N_JOINTS, 3))
    pose[:, 0] = _facing(plan)
    for name, rotation in plan.joints.items():
        pose[:, _JOINT[name]] = rotation
    pelvis_m = skeleton.joints_m[0] + plan.pelvis_m
    pelvis_m[:, 1] -= _STANDING_DROP * skeleton.joints_m[_JOINT["left_hip"], 1]
    _pose_legs(pose, skeleton, pelvis_m, plan)
    if plan.on_floor is not None:
        # Lift or lower the pelvis until the skin lies on the floor; legs and their skin follow.
        planned_m = pelvis_m[:, 1].copy()
        for _ in range(_SETTLING_ROUNDS):
            lowest_m = _lowest_m(skeleton, pose, _trans_m(skeleton, pelvis_m))
            lying_m = pelvis_m[:, 1] - lowest_m - _COMPRESSED_M
            pelvis_m[:, 1] = planned_m + plan.on_floor * (lying_m - planned_m)
            _pose_legs(pose, skeleton, pelvis_m, plan)
    return pack_theta(pose, _trans_m(skeleton, pelvis_m))


def _facing(plan: BodyPlan) -> Array:
    """(T, 3) axis-angle of the pelvis in the world, continuous beyond half a turn."""
    heading = np.broadcast_to(np.asarray(plan.heading, np.float64), (len(plan.pelvis_m),))
    if not heading.any():
        return plan.pelvis_turn
    about_y = Rotation.from_rotvec(np.outer(heading, _Y))
    whole = (about_y * Rotation.from_rotvec(plan.pelvis_turn)).as_rotvec()
    return continuous_rotations(whole[:, None])[:, 0]


def _trans_m(skeleton: Skeleton, pelvis_m: Array) -> Array:
    return pelvis_m - skeleton.joints_m[0] - (0.0, skeleton.floor_m, 0.0)


def _lowest_m(skeleton: Skeleton, pose: Array, trans_m: Array) -> Array:
    """(T,) height of the lowest bearing skin, of a `pose` (T, 22, 3) and translation (T, 3).

    It is a soft minimum, so that the body moves smoothly when other vertices touch the floor. It is
    rounded to a nanometre, as equal rows of a matrix product may differ in their last bits, but a
    body at rest must not move.
    """
    height_m = skeleton.bearing.pose(pose, trans_m)[..., 1]
    lowest_m = height_m.min(1, keepdims=True)
    soft = -_SOFTNESS_M * np.log(np.exp((lowest_m - height_m) / _SOFTNESS_M).sum(1))
    return np.round(lowest_m[:, 0] + soft, 9)


def _pose_legs(pose: Array, skeleton: Skeleton, pelvis_m: Array, plan: BodyPlan) -> None:
    """Set hips, knees, ankles and toes of a `pose` (T, 22, 3), so that the ball of each foot,
    SMPL's `foot` joint, is where the plan has it while the pelvis is at `pelvis_m` (T, 3)."""
    root, pelvis = skeleton.joints_m[0], Rotation.from_rotvec(pose[:, 0])
    for side, foot in zip(_SIDES, plan.feet, strict=True):
        joints = [_JOINT[f"{side}_{name}"] for name in ("hip", "knee", "ankle", "foot")]
        hip, knee, ankle, ball = skeleton.joints_m[joints]
        thigh, calf, heel = knee - hip, ankle - knee, ankle - ball
        hip_m = pelvis_m + pelvis.apply(hip - root)
        stand_m = ball.copy()
        stand_m[0] -= (1 - _STANCE_WIDTH) * (ankle[0] - hip[0])
        if np.any(foot.heading):  # the body has turned on the spot
            about_y = Rotation.from_rotvec(np.outer(foot.heading, _Y))
            axis_m = root * (1.0, 0.0, 1.0)
            stand_m = axis_m + about_y.apply(stand_m - axis_m)
        ball_m = np.broadcast_to(stand_m + foot.ball_m, hip_m.shape)
        yaw = np.broadcast_to(foot.yaw + foot.heading, len(hip_m))
        reach_m = _STRETCH * float(np.linalg.norm(thigh) + np.linalg.norm(calf))
        least = _least_pitch(hip_m, ball_m, heel, yaw, reach_m)
        # A smooth maximum of the planned pitch and the least one at which the leg is long enough.
        pitch = _HEEL_SOFTNESS * np.logaddexp(foot.pitch / _HEEL_SOFTNESS, least / _HEEL_SOFTNESS)
        turned = _foot_turn(pitch, yaw)
        target = pelvis.inv().apply(ball_m + turned.apply(heel) - hip_m)
        bent = _knee_angle(thigh, calf, np.linalg.norm(target, axis=1))
        # The hip points the bent leg at its target, and the knee's axis to the side.
        bending = Rotation.from_rotvec(np.outer(bent, _X))
        splay = Rotation.from_rotvec(np.outer(yaw - plan.heading, _Y))
        rest = _frame(thigh + bending.apply(calf), np.broadcast_to(_X, target.shape))
        aim = Rotation.from_matrix(_frame(target, splay.apply(_X)) @ rest.swapaxes(1, 2))
        ankle_turn = (pelvis * aim * bending).inv() * turned
        flat = 1 / (1 + (np.maximum(ball_m[:, 1] - ball[1], 0.0) / _TOES_FLAT_BELOW_M) ** 2)
        turns = [turn.as_rotvec() for turn in (aim, bending, ankle_turn)]
        pose[:, joints] = np.stack([*turns, np.outer(-pitch * flat, _X)], axis=1)


def _foot_turn(pitch: Array, yaw: Array) -> Rotation:
    return Rotation.from_euler("YX", np.stack([yaw, pitch], axis=1))


def _least_pitch(hip_m: Array, ball_m: Array, heel: Array, yaw: Array, reach_m: float) -> Array:
    """(T,) toes-down angle at which the ankle is as far from the hip as the leg reaches."""
    low, high = (np.full(yaw.shape, bound) for bound in _PITCH_RANGE)
    for _ in range(40):
        middle = (low + high) / 2
        ankle_m = ball_m + _foot_turn(middle, yaw).apply(heel)
        too_far = np.linalg.norm(ankle_m - hip_m, axis=1) > reach_m
        low, high = np.where(too_far, middle, low), np.where(too_far, high, middle)
    return high


def _knee_angle(thigh: Array, calf: Array, distance_m: Array) -> Array:
    """Flexion about x that puts the ankle at `distance_m` from the hip (law of cosines)."""
    cosine = thigh[1] * calf[1] + thigh[2] * calf[2]
    sine = thigh[2] * calf[1] - thigh[1] * calf[2]
    along = (distance_m**2 - thigh @ thigh - calf @ calf) / 2 - thigh[0] * calf[0]
    return np.arctan2(sine, cosine) + np.arccos(np.clip(along / np.hypot(sine, cosine), -1, 1))


def _frame(along: Array, lateral: Array) -> Array:
    """(T, 3, 3) with columns: direction of the leg, knee axis, and their cross product."""
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    lateral = lateral - (lateral * along).sum(1, keepdims=True) * along
    lateral = lateral / np.linalg.norm(lateral, axis=1, keepdims=True)
    return np.stack([along, lateral, np.cross(along, lateral)], axis=2)
