"""Which joints took the offsets: the work of each joint's error against the true offsets.

A small wrong turn w of a joint moves the vertices below it by w x (x - p), p being the joint's
place. The scalar product of that motion with the true offsets is w . sum (x - p) x f, the
offsets' torque about the joint if each offset is read as a force f on its vertex. So the share of
the offsets' energy that a joint took is the work of its error against that torque, and the shares
of all joints and of the translation add up to what the pose absorbed, to first order and but for
the pose blend shapes. A negative share gives back what other joints took.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from bridge.body import BodyModelData
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.posing import posed_joints
from bridge.motion import unpack_theta
from bridge.paper import N_JOINTS
from dsnet.evaluation.metrics import frame_blocks

CARRIERS = (*SMPL_JOINT_NAMES[:N_JOINTS], "translation")


@dataclass(frozen=True)
class JointLoads:
    """Torques of one sequence's true offsets, m^2: every aligner can be held against them."""

    theta: NDArray[np.float64]
    """(T, 69) true pose."""
    torque: NDArray[np.float64]
    """(T, 22, 3) about each joint, in its parent's frame."""
    force: NDArray[np.float64]
    """(T, 3) sum over all vertices."""

    @classmethod
    def of(
        cls,
        body: BodyModelData,
        betas: ArrayLike,
        theta: ArrayLike,
        offsets_m: NDArray[np.floating],
        meshes_m: NDArray[np.floating],
    ) -> JointLoads:
        """Loads of a known sequence.

        Parameters
        ----------
        betas : (10,) shape.
        theta : (T, 69).
        offsets_m : (T, V, 3) in the rest pose.
        meshes_m : (T, V, 3) posed, with the offsets.
        """
        theta = np.asarray(theta, dtype=np.float64)
        parts = [
            _torques(body, np.asarray(betas), theta[block], offsets_m[block], meshes_m[block])
            for block in frame_blocks(slice(0, len(theta)))
        ]
        torque, force = (np.concatenate(part) for part in zip(*parts, strict=True))
        return cls(theta, torque, force)

    def work(self, theta: ArrayLike) -> NDArray[np.float64]:
        """(23,) m^2 that each of `CARRIERS` took when the pose was found to be `theta` (T, 69).

        Divide by the sum of |true offset|^2 for shares.
        """
        turn, shift = pose_error(theta, self.theta)
        by_joints = np.einsum("tjx,tjx->j", turn, self.torque)
        return np.append(by_joints, np.vdot(shift, self.force))


def pose_error(
    theta: ArrayLike, reference: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What turns and moves `reference` into `theta`, both (T, 69).

    Returns
    -------
    (T, 22, 3) rotation vector of each joint in its parent's frame, radians, and (T, 3) metres.
    """
    (pose, trans), (true_pose, true_trans) = unpack_theta(theta), unpack_theta(reference)
    found, true = (Rotation.from_rotvec(part.reshape(-1, 3)) for part in (pose, true_pose))
    turn = (found * true.inv()).as_rotvec().reshape(pose.shape)
    return turn, np.subtract(trans, true_trans, dtype=np.float64)


def _torques(
    body: BodyModelData,
    betas: NDArray,
    theta: NDArray[np.float64],
    offsets_m: NDArray[np.floating],
    meshes_m: NDArray[np.floating],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    pose, trans = unpack_theta(theta)
    bones, places = posed_joints(body, betas, pose, trans)
    turns = bones[..., :3, :3]
    blended = np.einsum("vj,tjxy->tvxy", body.weights, turns, optimize=True)
    # The inverse of skinning, transposed, takes scalar products from the rest pose to the world.
    forces = np.linalg.solve(blended.swapaxes(-1, -2), offsets_m[..., None])[..., 0]
    moments = np.cross(meshes_m, forces)
    below = body.weights @ _subtrees(body.parents)
    force, moment = (np.einsum("vj,tvx->tjx", below, v, optimize=True) for v in (forces, moments))
    torque = (moment - np.cross(places, force))[:, :N_JOINTS]
    torque[:, 1:] = np.einsum("tjyx,tjy->tjx", turns[:, body.parents[1:N_JOINTS]], torque[:, 1:])
    return torque, force[:, 0]


def _subtrees(parents: NDArray[np.int64]) -> NDArray[np.float64]:
    """(J, J) ones where the row's joint is the column's or hangs below it."""
    below = np.eye(len(parents))
    for joint in range(len(parents) - 1, 0, -1):
        below[:, parents[joint]] += below[:, joint]
    return below
