"""From a plan to the paper's pose vector, for the proportions of one subject."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from bridge.body import BodyModelData
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.posing import shaped_vertices
from bridge.motion import pack_theta
from bridge.motion.resampling import continuous_rotations
from bridge.paper import N_JOINTS
from torch_align_ae.corpus.motions.floor import BearingSkin
from torch_align_ae.corpus.motions.leg import Leg, pose_leg
from torch_align_ae.corpus.motions.plan import Array, BodyPlan, FootPath

_JOINT = {name: index for index, name in enumerate(SMPL_JOINT_NAMES)}
_AVERAGE_LEG_M = 0.85
# Knees are a little bent in standing: straight legs could not take up any movement.
_STANDING_DROP = 0.022
# Feet stand closer than in the T-pose, whose legs are spread.
_STANCE_WIDTH = 0.55
# Flesh gives way under the body's weight.
_SINKS_IN_M = 0.004
_SETTLING_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class Skeleton:
    """The joints of one subject in the rest pose, with the floor under the feet at y = 0."""

    joints_m: Array
    """(24, 3) joints, metres above the floor."""
    floor_m: float
    """Height of the floor in the body model's own coordinates."""
    skin: BearingSkin
    """What it sits and lies on."""

    @classmethod
    def of(cls, data: BodyModelData, betas: Array) -> Skeleton:
        """Skeleton of the body with shape `betas` (10,)."""
        vertices = shaped_vertices(data, betas[None])[0]
        floor_m = float(vertices[:, 1].min())
        joints_m = data.J_regressor @ vertices - (0.0, floor_m, 0.0)
        return cls(joints_m, floor_m, BearingSkin.of(data, betas))

    @property
    def size(self) -> float:
        """Leg length relative to an average one."""
        return float(self.joints_m[_JOINT["left_hip"], 1]) / _AVERAGE_LEG_M

    def leg(self, side: str) -> Leg:
        """The `left` or `right` leg."""
        names = ("hip", "knee", "ankle", "foot")
        return Leg(*(self.joints_m[_JOINT[f"{side}_{name}"]] for name in names))


def pose_body(skeleton: Skeleton, plan: BodyPlan) -> Array:
    """theta (T, 69) of the subject who follows `plan`."""
    pose = np.zeros((len(plan.pelvis_m), N_JOINTS, 3))
    pose[:, 0] = _facing(plan)
    for name, rotation in plan.joints.items():
        pose[:, _JOINT[name]] = rotation
    pelvis = skeleton.joints_m[0]
    pelvis_m = pelvis + plan.pelvis_m
    pelvis_m[:, 1] -= _STANDING_DROP * skeleton.joints_m[_JOINT["left_hip"], 1]
    _pose_legs(pose, skeleton, pelvis_m, plan)
    if plan.carried is not None:
        _lay_down(pose, skeleton, pelvis_m, plan, plan.carried)
    return pack_theta(pose, _trans_m(skeleton, pelvis_m))


def _facing(plan: BodyPlan) -> Array:
    """(T, 3) axis-angle of the pelvis in the world, continuous beyond half a turn."""
    heading = np.broadcast_to(np.asarray(plan.heading, np.float64), (len(plan.pelvis_m),))
    if not heading.any():
        return plan.pelvis_turn
    about_y = Rotation.from_rotvec(np.outer(heading, (0.0, 1.0, 0.0)))
    whole = (about_y * Rotation.from_rotvec(plan.pelvis_turn)).as_rotvec()
    return continuous_rotations(whole[:, None])[:, 0]


def _trans_m(skeleton: Skeleton, pelvis_m: Array) -> Array:
    return pelvis_m - skeleton.joints_m[0] - (0.0, skeleton.floor_m, 0.0)


def _lay_down(
    pose: Array, skeleton: Skeleton, pelvis_m: Array, plan: BodyPlan, carried: Array
) -> None:
    """Lift or lower the pelvis until the skin lies on the floor; legs and their skin follow."""
    planned_m = pelvis_m[:, 1].copy()
    for _ in range(_SETTLING_ROUNDS):
        lowest_m = skeleton.skin.lowest_m(pose, _trans_m(skeleton, pelvis_m))
        lying_m = pelvis_m[:, 1] - lowest_m - _SINKS_IN_M
        pelvis_m[:, 1] = planned_m + carried * (lying_m - planned_m)
        _pose_legs(pose, skeleton, pelvis_m, plan)


def _pose_legs(pose: Array, skeleton: Skeleton, pelvis_m: Array, plan: BodyPlan) -> None:
    for side, foot in (("left", plan.left_foot), ("right", plan.right_foot)):
        _pose_side(pose, skeleton, side, pelvis_m, foot, plan.heading)


def _pose_side(
    pose: Array,
    skeleton: Skeleton,
    side: str,
    pelvis_m: Array,
    foot: FootPath,
    heading: Array | float,
) -> None:
    leg = skeleton.leg(side)
    turn = Rotation.from_rotvec(pose[:, 0])
    hip_m = pelvis_m + turn.apply(leg.hip_m - skeleton.joints_m[0])
    stand_m = leg.ball_m.copy()
    stand_m[0] -= (1 - _STANCE_WIDTH) * (leg.ankle_m[0] - leg.hip_m[0])
    place_m = _turned_about(skeleton.joints_m[0], stand_m, foot.heading) + foot.ball_m
    found = pose_leg(leg, turn, hip_m, foot, place_m, heading)
    for name, rotation in (
        ("hip", found.hip),
        ("knee", found.knee),
        ("ankle", found.ankle),
        ("foot", found.toes),
    ):
        pose[:, _JOINT[f"{side}_{name}"]] = rotation


def _turned_about(pelvis_m: Array, stand_m: Array, heading: Array | float) -> Array:
    """(T, 3) or (3,) place of a foot of a body that has turned on the spot."""
    if not np.any(heading):
        return stand_m
    about_y = Rotation.from_rotvec(np.outer(heading, (0.0, 1.0, 0.0)))
    axis_m = pelvis_m * (1.0, 0.0, 1.0)
    return axis_m + about_y.apply(stand_m - axis_m)
