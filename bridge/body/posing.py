"""Pose and unpose a body in float64 NumPy: slow, obvious, and the oracle of the fast paths."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from bridge.body.model_data import JOINT_COUNT, BodyModelData
from bridge.errors import DsnetError


def joint_transforms(
    rotations: np.ndarray, joints: np.ndarray, parents: np.ndarray, trans: np.ndarray
) -> np.ndarray:
    """Transform of each bone from the rest pose to the world.

    The root turns about its own joint and is then moved by `trans`, as in SMPL.

    Parameters
    ----------
    rotations : (B, 24, 3, 3) rotation of each joint relative to its parent.
    joints : (B, 24, 3) joints of the rest pose, metres.
    parents : (24,) parent of each joint, -1 for the root.
    trans : (B, 3) translation, metres.

    Returns
    -------
    (B, 24, 4, 4) `T_world_rest`, homogeneous.
    """
    T_world_joint = np.zeros((*rotations.shape[:2], 4, 4))
    for joint, parent in enumerate(parents):
        local = np.zeros((len(rotations), 4, 4))
        local[:, :3, :3] = rotations[:, joint]
        local[:, 3, 3] = 1.0
        if parent < 0:
            local[:, :3, 3] = joints[:, joint] + trans
            T_world_joint[:, joint] = local
        else:
            local[:, :3, 3] = joints[:, joint] - joints[:, parent]
            T_world_joint[:, joint] = T_world_joint[:, parent] @ local
    T_world_rest = T_world_joint.copy()
    T_world_rest[..., :3, 3] -= np.einsum("bjxy,bjy->bjx", T_world_joint[..., :3, :3], joints)
    return T_world_rest


def pose_features(rotations: np.ndarray) -> np.ndarray:
    """(B, 207) entries of R - I of joints 1..23, row by row, from (B, 24, 3, 3)."""
    return (rotations[:, 1:] - np.eye(3)).reshape(len(rotations), -1)


def pose_vertices(
    data: BodyModelData,
    betas: np.ndarray,
    pose: np.ndarray,
    trans: np.ndarray,
    offsets: np.ndarray | None = None,
) -> np.ndarray:
    """Posed vertices, Eq. 1-2, with `offsets` added in the rest pose.

    Parameters
    ----------
    data : the body model.
    betas : (B, 10) shape.
    pose : (B, 22, 3) or (B, 24, 3) axis-angle, radians; missing hand joints stay at rest.
    trans : (B, 3) translation, metres.
    offsets : (B, V, 3) displacement in the rest pose, or None.

    Returns
    -------
    (B, V, 3) vertices, metres.

    Raises
    ------
    DsnetError
        If an argument has the wrong shape.
    """
    rest, blended = _rest_and_skinning(data, betas, pose, trans)
    if offsets is not None:
        _check_shape("offsets", offsets, rest.shape)
        rest = rest + offsets
    return np.einsum("bvxy,bvy->bvx", blended[..., :3, :3], rest) + blended[..., :3, 3]


def unpose_vertices(
    data: BodyModelData,
    vertices: np.ndarray,
    betas: np.ndarray,
    pose: np.ndarray,
    trans: np.ndarray,
) -> np.ndarray:
    """Rest-pose vertices of a posed mesh: the inverse skinning W^-1 of Eq. 5.

    The pose blend shapes stay in the result, so Eq. 5's offsets are
    `unpose_vertices(...) - rest_vertices(...)`.

    Parameters
    ----------
    data, betas, pose, trans : as in `pose_vertices`.
    vertices : (B, V, 3) posed mesh, metres.

    Returns
    -------
    (B, V, 3) rest-pose vertices, metres.

    Raises
    ------
    DsnetError
        If an argument has the wrong shape.
    """
    rest, blended = _rest_and_skinning(data, betas, pose, trans)
    _check_shape("vertices", vertices, rest.shape)
    centred = np.asarray(vertices, dtype=np.float64) - blended[..., :3, 3]
    return np.linalg.solve(blended[..., :3, :3], centred[..., None])[..., 0]


def rest_vertices(data: BodyModelData, betas: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """(B, V, 3) shaped body with pose blend shapes, before skinning (Eq. 2), metres."""
    features = pose_features(joint_rotations(data, pose))
    return shaped_vertices(data, betas) + np.einsum("vxp,bp->bvx", data.posedirs, features)


def shaped_vertices(data: BodyModelData, betas: np.ndarray) -> np.ndarray:
    """(B, V, 3) template plus shape blend shapes, metres."""
    betas = np.asarray(betas, dtype=np.float64)
    _check_shape("betas", betas, (len(betas), data.shapedirs.shape[-1]))
    return data.v_template + np.einsum("vxs,bs->bvx", data.shapedirs, betas)


def shaped_joints(data: BodyModelData, betas: np.ndarray) -> np.ndarray:
    """(B, 24, 3) joints of the shaped body in the rest pose, metres."""
    return np.array([data.J_regressor @ vertices for vertices in shaped_vertices(data, betas)])


def _rest_and_skinning(
    data: BodyModelData, betas: np.ndarray, pose: np.ndarray, trans: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rest vertices (B, V, 3) and each vertex's blended transform (B, V, 4, 4)."""
    trans = np.asarray(trans, dtype=np.float64)
    _check_shape("trans", trans, (len(np.asarray(betas)), 3))
    rest = rest_vertices(data, betas, pose)
    bones = joint_transforms(
        joint_rotations(data, pose), shaped_joints(data, betas), data.parents, trans
    )
    return rest, np.einsum("vj,bjxy->bvxy", data.weights, bones)


def joint_rotations(data: BodyModelData, pose: np.ndarray) -> np.ndarray:
    """(B, 24, 3, 3) rotation matrices; the hand joints of a 22-joint pose are the identity."""
    pose = np.asarray(pose, dtype=np.float64)
    if pose.ndim != 3 or pose.shape[1:] not in ((JOINT_COUNT - 2, 3), (JOINT_COUNT, 3)):
        raise DsnetError(
            f"pose has shape {pose.shape}", "(B, 22, 3) or (B, 24, 3)", "Pass axis-angle vectors"
        )
    padded = np.zeros((len(pose), JOINT_COUNT, 3))
    padded[:, : pose.shape[1]] = pose
    matrices = Rotation.from_rotvec(padded.reshape(-1, 3)).as_matrix()
    return matrices.reshape(len(pose), JOINT_COUNT, 3, 3)


def _check_shape(name: str, array: np.ndarray, shape: tuple[int, ...]) -> None:
    if np.shape(array) != shape:
        raise DsnetError(
            f"{name} has shape {np.shape(array)}", f"shape {shape}", "Reshape it or its partners"
        )
