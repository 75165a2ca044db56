"""From a plan to the paper's pose vector, for the proportions of one subject."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from bridge.body import BodyModelData
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.posing import shaped_vertices
from bridge.motion import pack_theta
from bridge.paper import N_JOINTS
from torch_align_ae.corpus.motions.leg import Leg, pose_leg
from torch_align_ae.corpus.motions.plan import Array, BodyPlan, FootPath

_JOINT = {name: index for index, name in enumerate(SMPL_JOINT_NAMES)}
_AVERAGE_LEG_M = 0.85
# Knees are a little bent in standing: straight legs could not take up any movement.
_STANDING_DROP = 0.022
# Feet stand closer than in the T-pose, whose legs are spread.
_STANCE_WIDTH = 0.55


@dataclass(frozen=True, eq=False)
class Skeleton:
    """The joints of one subject in the rest pose, with the floor under the feet at y = 0."""

    joints_m: Array
    """(24, 3) joints, metres above the floor."""
    floor_m: float
    """Height of the floor in the body model's own coordinates."""

    @classmethod
    def of(cls, data: BodyModelData, betas: Array) -> Skeleton:
        """Skeleton of the body with shape `betas` (10,)."""
        vertices = shaped_vertices(data, betas[None])[0]
        floor_m = float(vertices[:, 1].min())
        return cls(data.J_regressor @ vertices - (0.0, floor_m, 0.0), floor_m)

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
    pose[:, 0] = plan.pelvis_turn
    for name, rotation in plan.joints.items():
        pose[:, _JOINT[name]] = rotation
    pelvis = skeleton.joints_m[0]
    pelvis_m = pelvis + plan.pelvis_m
    pelvis_m[:, 1] -= _STANDING_DROP * skeleton.joints_m[_JOINT["left_hip"], 1]
    for side, foot in (("left", plan.left_foot), ("right", plan.right_foot)):
        _pose_side(pose, skeleton, side, pelvis_m, foot)
    trans = pelvis_m - pelvis
    trans[:, 1] -= skeleton.floor_m
    return pack_theta(pose, trans)


def _pose_side(pose: Array, skeleton: Skeleton, side: str, pelvis_m: Array, foot: FootPath) -> None:
    leg = skeleton.leg(side)
    turn = Rotation.from_rotvec(pose[:, 0])
    hip_m = pelvis_m + turn.apply(leg.hip_m - skeleton.joints_m[0])
    stand_m = leg.ball_m.copy()
    stand_m[0] -= (1 - _STANCE_WIDTH) * (leg.ankle_m[0] - leg.hip_m[0])
    found = pose_leg(leg, turn, hip_m, foot, stand_m + foot.ball_m)
    for name, rotation in (
        ("hip", found.hip),
        ("knee", found.knee),
        ("ankle", found.ankle),
        ("foot", found.toes),
    ):
        pose[:, _JOINT[f"{side}_{name}"]] = rotation
