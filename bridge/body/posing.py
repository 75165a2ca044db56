"""Pose a body in NumPy (Eq. 1-2).

`pose_vertices` is in float64, slow, obvious, and the oracle of the fast paths. `Smpl` poses by
matrix products, in float32 or float64, all vertices or some: a body's shape
does not change within a motion, so it is blended once, and within a frame each component's numbers
lie side by side, as NumPy's loops then run along vertices and not along three coordinates.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.body.model_data import HAND_COUNT, BodyModelData
from bridge.errors import DsnetError
from bridge.paper import N_JOINTS

_FRAMES_AT_ONCE = 64
"""A product for many rows costs each of them less; the others wait, so that memory is bounded."""
_WITH_A_KIDS = 11


def joint_transforms(
    rotations: np.ndarray, joints: np.ndarray, parents: np.ndarray, trans: np.ndarray
) -> np.ndarray:
    """(B, J, 4, 4) `T_world_rest`: each bone's homogeneous transform from the rest pose.

    The root turns about its own joint and is then moved by `trans`, as in SMPL.

    Parameters
    ----------
    rotations : (B, J, 3, 3) rotation of each joint relative to its parent.
    joints : (B, J, 3) joints of the rest pose, metres.
    parents : (J,) parent of each joint, -1 for the root.
    trans : (B, 3) translation, metres.
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


def posed_joints(
    data: BodyModelData, betas: np.ndarray, pose: np.ndarray, trans: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Bones (T, J, 4, 4), as `joint_transforms`, and joints (T, J, 3), metres, of a shape (k,) in
    T frames of pose and translation."""
    rest = shaped_joints(data, betas[None]).repeat(len(pose), axis=0)
    bones = joint_transforms(joint_rotations(data, pose), rest, data.parents, trans)
    return bones, np.einsum("tjxy,tjy->tjx", bones[..., :3, :3], rest) + bones[..., :3, 3]


def pose_features(rotations: np.ndarray) -> np.ndarray:
    """(B, 9 (J - 1)) entries of R - I of all joints but the root, row by row, of (B, J, 3, 3)."""
    return (rotations[:, 1:] - np.eye(3)).reshape(len(rotations), -1)


def pose_vertices(
    data: BodyModelData,
    betas: np.ndarray,
    pose: np.ndarray,
    trans: np.ndarray,
    offsets: np.ndarray | None = None,
) -> np.ndarray:
    """(B, V, 3) posed vertices, metres, Eq. 1-2, with `offsets` added in the rest pose.

    Parameters
    ----------
    betas : (B, k) shape, the first of the body's or all.
    pose : (B, J, 3) axis-angle, radians, or (B, 22, 3): hands and face stay at rest. SMPL's
        (B, 24, 3) poses the first 22 of another kind.
    trans : (B, 3) translation, metres.
    offsets : (B, V, 3) displacement in the rest pose, or None.
    """
    trans = np.asarray(trans, dtype=np.float64)
    _check_shape("trans", trans, (len(np.asarray(betas)), 3))
    rest = rest_vertices(data, betas, pose)
    if offsets is not None:
        _check_shape("offsets", offsets, rest.shape)
        rest = rest + offsets
    bones = joint_transforms(
        joint_rotations(data, pose), shaped_joints(data, betas), data.parents, trans
    )
    blended = np.einsum("vj,bjxy->bvxy", data.weights, bones)
    return np.einsum("bvxy,bvy->bvx", blended[..., :3, :3], rest) + blended[..., :3, 3]


def rest_vertices(data: BodyModelData, betas: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """(B, V, 3) shaped body with pose blend shapes, before skinning (Eq. 2), metres."""
    features = pose_features(joint_rotations(data, pose))
    return shaped_vertices(data, betas) + np.einsum("vxp,bp->bvx", data.posedirs, features)


def shaped_vertices(data: BodyModelData, betas: np.ndarray) -> np.ndarray:
    """(B, V, 3) template plus shape blend shapes of betas (B, k), metres."""
    betas = np.asarray(betas, dtype=np.float64)
    count = betas.shape[-1] if betas.ndim else 0
    _check_shape("betas", betas, (len(betas), min(count, data.shapedirs.shape[-1])))
    return data.v_template + np.einsum("vxs,bs->bvx", data.shapedirs[..., :count], betas)


def shaped_joints(data: BodyModelData, betas: np.ndarray) -> np.ndarray:
    """(B, J, 3) joints of the shaped body in the rest pose, metres."""
    return np.array([data.J_regressor @ vertices for vertices in shaped_vertices(data, betas)])


def joint_rotations(data: BodyModelData, pose: np.ndarray) -> np.ndarray:
    """(B, J, 3, 3) rotation matrices; of joints that `pose` lacks, the identity."""
    pose, joints = np.asarray(pose, dtype=np.float64), len(data.parents)
    if (
        pose.ndim != 3
        or pose.shape[1] not in (N_JOINTS, N_JOINTS + 2, joints)
        or pose.shape[2] != 3
    ):
        shapes = f"(B, {N_JOINTS}, 3) or (B, {joints}, 3)"
        raise DsnetError(f"pose has shape {pose.shape}", shapes, "Pass axis-angle vectors")
    padded = np.zeros((len(pose), joints, 3))
    given = joints if pose.shape[1] == joints else N_JOINTS
    padded[:, :given] = pose[:, :given]
    matrices = Rotation.from_rotvec(padded.reshape(-1, 3)).as_matrix()
    return matrices.reshape(len(pose), joints, 3, 3)


def fitted_betas(
    data: BodyModelData, betas: NDArray[np.floating]
) -> tuple[NDArray[np.float64], str | None]:
    """(k,) the coefficients that a body has shapes for, of all that a file has, and a note about
    the others."""
    betas = np.asarray(betas, np.float64)
    shapes = data.shapedirs.shape[2]
    if len(betas) == _WITH_A_KIDS < shapes:
        return betas[:-1], "the last of 11 betas is left out: BEDLAM's and AGORA's is a kid's"
    left = betas[shapes:]
    if not left.any():
        return betas[:shapes], None
    return betas[:shapes], (
        f"{len(left)} of {len(betas)} betas are left out: {data.name} has {shapes} shapes"
    )


def full_pose(
    pose: NDArray[np.floating], hands_and_face: NDArray[np.floating] | None, joints: int
) -> NDArray[np.floating]:
    """(T, joints, 3) of 22 joints (T, 22, 3) and `bridge.motion.Motion.hands_and_face`; `joints`
    are SMPL-H's 52 or SMPL-X's 55.

    Fingers go to the fingers, jaw and eyes to SMPL-X's; what the skeleton lacks is left out, and
    what the motion lacks stays at rest.
    """
    full = np.zeros((len(pose), joints, 3), pose.dtype)
    full[:, :N_JOINTS] = pose
    if hands_and_face is not None:
        full[:, -HAND_COUNT:] = hands_and_face[:, -HAND_COUNT:]
        if joints - N_JOINTS == hands_and_face.shape[1]:
            full[:, N_JOINTS:] = hands_and_face
    return full


def _check_shape(name: str, array: np.ndarray, shape: tuple[int, ...]) -> None:
    if np.shape(array) != shape:
        raise DsnetError(
            f"{name} has shape {np.shape(array)}", f"shape {shape}", "Reshape it or its partners"
        )


class Smpl:
    """What all persons of a body model share: how vertices follow bones and poses.

    Parameters
    ----------
    data : the body model.
    vertices : (K,) which; all when None.
    dtype : of what is done for each vertex; the bones are few and stay float64.
    hands : whether fingers and faces of SMPL-H and SMPL-X are ever posed; else they cost nothing.
    """

    def __init__(
        self,
        data: BodyModelData,
        vertices: NDArray[np.integer] | None = None,
        dtype: type[np.floating] = np.float32,
        hands: bool = True,
    ) -> None:
        self.data, self.dtype = data, dtype
        self.vertices = np.arange(data.vertex_count) if vertices is None else vertices
        whole = hands or data.kind == "smpl"
        self._joints = len(data.parents) if whole else N_JOINTS
        by_pose = data.posedirs[self.vertices].transpose(2, 1, 0)[: 9 * (self._joints - 1)]
        self._posedirs = np.ascontiguousarray(by_pose, self.dtype).reshape(len(by_pose), -1)
        weights = data.weights if whole else data.body_weights
        self._weights = np.ascontiguousarray(weights[self.vertices].T, self.dtype)

    def person(self, betas: NDArray) -> ShapedBody:
        """A person of shape betas (k,), the first of the body's or all."""
        shape = np.asarray(betas, np.float64)[None]
        rest_m = shaped_vertices(self.data, shape)[0, self.vertices].T
        return ShapedBody(
            self, np.ascontiguousarray(rest_m, self.dtype), shaped_joints(self.data, shape)
        )

    def pose(
        self,
        people: Sequence[ShapedBody],
        pose: NDArray,
        trans: NDArray,
        offsets: NDArray | None = None,
    ) -> NDArray[np.floating]:
        """Posed vertices (T, K, 3), metres, of one person in T frames or of T in one frame each.

        Parameters
        ----------
        pose : (T, J, 3) or (T, 22, 3) axis-angle, radians; see `pose_vertices`.
        trans : (T, 3) translation, metres.
        offsets : (T, K, 3) displacement in the rest pose, metres; none when None.
        """
        vertices = np.empty((len(pose), len(self.vertices), 3), self.dtype)
        for frame, (rest, blended) in enumerate(self.frames(people, pose, trans, offsets)):
            vertices[frame] = _moved(rest, blended).T
        return vertices

    def frames(
        self, people: Sequence[ShapedBody], pose: NDArray, trans: NDArray, offsets: NDArray | None
    ) -> Iterator[tuple[NDArray, NDArray]]:
        """Of each frame the rest pose (3, K) and each vertex's transform (3, 4, K)."""
        for start in range(0, len(pose), _FRAMES_AT_ONCE):
            part = slice(start, start + _FRAMES_AT_ONCE)
            some = people[part] if len(people) > 1 else people
            rotations = joint_rotations(self.data, pose[part])[:, : self._joints]
            joints = np.concatenate([person.joints_m for person in some])[:, : self._joints]
            joints = np.broadcast_to(joints, (len(rotations), *joints.shape[1:]))
            parents = self.data.parents[: self._joints]
            bones = joint_transforms(rotations, joints, parents, trans[part])
            # Weights sum to 1 only up to rounding; blended this way, standing is no turn exactly.
            moved = (bones[:, :, :3] - np.eye(3, 4)).transpose(0, 2, 3, 1).astype(self.dtype)
            moved = moved.reshape(len(moved), 12, -1)
            features = pose_features(rotations).astype(self.dtype)
            rest = (features @ self._posedirs).reshape(len(features), 3, -1)
            for row, bone in enumerate(moved):
                rest[row] += some[row % len(some)].rest_m
                if offsets is not None:
                    rest[row] += offsets[start + row].T
                blended = (bone @ self._weights).reshape(3, 4, -1)
                for axis in range(3):
                    blended[axis, axis] += 1
                yield rest[row], blended


def _moved(rest: NDArray, blended: NDArray) -> NDArray:
    """(3, K) the vertices of a rest pose (3, K), by their transforms (3, 4, K)."""
    placed = np.einsum("xyk,yk->xk", blended[:, :3], rest)
    placed += blended[:, 3]
    return placed


@dataclass(frozen=True, eq=False)
class ShapedBody:
    """One person's shape."""

    smpl: Smpl
    rest_m: NDArray[np.floating]
    """(3, K) vertices in the rest pose."""
    joints_m: NDArray[np.float64]
    """(1, J, 3) in the rest pose."""

    def pose(
        self, pose: NDArray, trans: NDArray, offsets: NDArray | None = None
    ) -> NDArray[np.floating]:
        """Posed vertices (T, K, 3) of T frames; see `Smpl.pose`."""
        return self.smpl.pose([self], pose, trans, offsets)

    def skin(self, pose: NDArray, trans: NDArray) -> tuple[NDArray, NDArray]:
        """Places (T, K, 3), metres, of T frames, and what turns each vertex (T, K, 3, 3): the
        linear part of its skinning transform."""
        count, dtype = len(self.smpl.vertices), self.smpl.dtype
        places = np.empty((len(pose), 3, count), dtype)
        turns = np.empty((len(pose), 3, 3, count), dtype)
        for frame, (rest, blended) in enumerate(self.smpl.frames([self], pose, trans, None)):
            places[frame], turns[frame] = _moved(rest, blended), blended[:, :3]
        return places.transpose(0, 2, 1), turns.transpose(0, 3, 1, 2)
