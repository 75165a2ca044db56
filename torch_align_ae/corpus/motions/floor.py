"""Where the skin of a body that sits or lies meets the floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.posing import joint_rotations, joint_transforms, pose_features, shaped_vertices
from torch_align_ae.corpus.motions.plan import Array

_JOINT = {name: index for index, name in enumerate(SMPL_JOINT_NAMES)}
_BEARING = ("pelvis", "spine1", "spine2", "spine3", "neck", "head", "left_hip", "right_hip")
_SOFTNESS_M = 0.003
_EVERY = 2


@dataclass(frozen=True, eq=False)
class BearingSkin:
    """Skin of trunk, head, buttocks and thighs, on which a person sits and lies."""

    data: BodyModelData
    rest_m: Array
    """(N, 3) in the rest pose, in the body model's own coordinates."""
    joints_m: Array
    """(24, 3) likewise."""
    chosen: NDArray[np.integer]
    """(N,) their vertices."""

    @classmethod
    def of(cls, data: BodyModelData, betas: Array) -> BearingSkin:
        """Skin of the body with shape `betas` (10,)."""
        vertices = shaped_vertices(data, betas[None])[0]
        bones = [_JOINT[name] for name in _BEARING]
        chosen = np.flatnonzero(data.weights[:, bones].sum(1) > 0.5)[::_EVERY]
        return cls(data, vertices[chosen], data.J_regressor @ vertices, chosen)

    def lowest_m(self, pose: Array, trans_m: Array) -> Array:
        """(T,) height of the lowest skin, of a `pose` (T, 22, 3) and translation (T, 3).

        A soft minimum, so that one vertex after another touches the floor without a jerk. Rounded
        to a nanometre: products of matrices differ in their last bits between equal rows, and a
        body that lies still must be still.
        """
        rotations = joint_rotations(self.data, pose)
        joints = np.broadcast_to(self.joints_m, (len(pose), *self.joints_m.shape))
        bones = joint_transforms(rotations, joints, self.data.parents, trans_m)
        blended = np.einsum("nj,tjx->tnx", self.data.weights[self.chosen], bones[:, :, 1])
        corrections = np.tensordot(
            pose_features(rotations), self.data.posedirs[self.chosen], axes=(1, 2)
        )
        places = self.rest_m + corrections
        height_m = (blended[..., :3] * places).sum(-1) + blended[..., 3]
        lowest_m = height_m.min(1, keepdims=True)
        soft = -_SOFTNESS_M * np.log(np.exp((lowest_m - height_m) / _SOFTNESS_M).sum(1))
        return np.round(lowest_m[:, 0] + soft, 9)
