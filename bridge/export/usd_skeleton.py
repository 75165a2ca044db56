"""The moving body as UsdSkel has it: SMPL's skeleton and weights, and blend shapes for the rest.

Joint rotations and skinning weights are SMPL's, exactly. What SMPL and the predictor add before
skinning, pose blend shapes and skin offsets, is some ten thousand numbers a frame, but few of its
directions matter in one motion. The principal ones of its frames become blend shapes, as many as
are needed, with a weight a frame: for each direction one shape along it and one against it, scaled
so that weights stay within 0 and 1, for Blender cuts off what is below. The largest error that this
makes is written into the prim's custom data.
"""

# USD's modules are compiled and come without types.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt
from scipy.spatial.transform import Rotation

from bridge.body.model_data import KIND_OF_JOINTS, SKELETONS
from bridge.body.posing import joint_rotations, pose_features, shaped_joints, shaped_vertices
from bridge.export.mesh_files import VertexNormals
from bridge.motion import unpack_theta
from bridge.runtime.moving_body import MovedFrames, MovingBody

FRAMES_FITTED = 256
"""At most so many frames, evenly spaced, are looked at for directions."""
MOST_SHAPES = 64
"""Directions at most; engines grow slow with more. A frame uses one shape of each."""
ENOUGH_M = 2e-4
"""Largest error of a vertex in the frames that are looked at, where fewer than the most do."""


class SkeletonVariant:
    """Gathers a moving body's frames, and writes them as a skeleton with blend shapes.

    Predicts the motion once, to find as many `directions` (K, 3V), orthonormal, as its rest poses
    need to move in about their mean.
    """

    def __init__(self, moving: MovingBody) -> None:
        self._body, self._motion = moving.body, moving.motion
        self._shaped_m = shaped_vertices(self._body, moving.motion.betas[None])[0]
        posedirs = self._body.posedirs
        self._posedirs = posedirs.reshape(-1, posedirs.shape[-1]).T.astype(np.float32)
        self._weights_m: list[NDArray[np.float32]] = []
        self._error_m = 0.0
        chosen = np.linspace(0, len(moving) - 1, min(FRAMES_FITTED, len(moving)))
        chosen, kept = chosen.round().astype(int), []
        for posed in moving:
            inside = chosen[(chosen >= posed.frames.start) & (chosen < posed.frames.stop)]
            kept.append(self.displaced_m(posed)[inside - posed.frames.start])
        frames_m = np.concatenate(kept)
        self._mean_m = frames_m.mean(axis=0)
        _, size, directions = np.linalg.svd(frames_m - self._mean_m, full_matrices=False)
        # A direction that no frame takes is rounding.
        directions = directions[: np.count_nonzero(size > 1e-6 * max(size[0], 1e-9))]
        self.directions: NDArray[np.float32] = directions[:MOST_SHAPES]
        weights_m = self.weights_m(frames_m)
        for count in range(1, len(self.directions)):
            if self.error_m(frames_m, weights_m[:, :count]) <= ENOUGH_M:
                self.directions = self.directions[:count]
                break

    def displaced_m(self, posed: MovedFrames) -> NDArray[np.float32]:
        """(T', 3V) of each frame's rest pose from the shaped body: before skinning, metres."""
        pose, _ = unpack_theta(self._motion.theta[posed.frames])
        moved_m = posed.offsets_m.reshape(len(posed), -1).copy()
        features = pose_features(joint_rotations(self._body, pose))
        moved_m += features.astype(np.float32) @ self._posedirs
        return moved_m

    def weights_m(self, moved_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """(T', K) of displacements (T', 3V)."""
        return np.asarray((moved_m - self._mean_m) @ self.directions.T, np.float32)

    def error_m(self, moved_m: NDArray[np.float32], weights_m: NDArray[np.float32]) -> float:
        """Largest distance of a vertex from where it should be, with the first weights (T', K')."""
        shown_m = weights_m @ self.directions[: weights_m.shape[1]]
        missed = moved_m - self._mean_m - shown_m
        return float(np.linalg.norm(missed.reshape(len(moved_m), -1, 3), axis=-1).max())

    def add(self, posed: MovedFrames) -> None:
        """The next frames: their weights, and the error that is left."""
        moved_m = self.displaced_m(posed)
        weights_m = self.weights_m(moved_m)
        self._weights_m.append(weights_m)
        self._error_m = max(self._error_m, self.error_m(moved_m, weights_m))

    def write(self, stage: Usd.Stage, root: str, mesh: str) -> None:
        """Define the skeleton below `root`, and bind `mesh`, where the stage is edited now."""
        names, directions, weights_m = self._one_sided()
        reach_m = weights_m.max(axis=0)
        skel_root = UsdSkel.Root.Define(stage, root)
        skel_root.GetPrim().SetCustomDataByKey("largest_error_mm", 1e3 * self._error_m)
        parents = self._body.parents
        joints_m = shaped_joints(self._body, self._motion.betas[None])[0]
        local_m = joints_m - np.where(parents[:, None] < 0, 0.0, joints_m[parents])
        skeleton = UsdSkel.Skeleton.Define(stage, f"{root}/Skeleton")
        skeleton.CreateJointsAttr(_joint_paths(parents))
        skeleton.CreateBindTransformsAttr(_translations(joints_m))
        skeleton.CreateRestTransformsAttr(_translations(local_m))
        animation = UsdSkel.Animation.Define(stage, f"{root}/Animation")
        animation.CreateJointsAttr(_joint_paths(parents))
        animation.CreateBlendShapesAttr(Vt.TokenArray(names))
        self._animate(animation, local_m, weights_m / reach_m)
        UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
        UsdSkel.BindingAPI(skeleton).CreateAnimationSourceRel().SetTargets([animation.GetPath()])
        binding = self._bind_mesh(stage, mesh, skeleton)
        binding.CreateBlendShapesAttr(Vt.TokenArray(names))
        targets = binding.CreateBlendShapeTargetsRel()
        for name, direction, reach in zip(names, directions, reach_m, strict=True):
            shape = UsdSkel.BlendShape.Define(stage, f"{mesh}/{name}")
            shape.CreateOffsetsAttr(vectors(direction.reshape(-1, 3) * reach))
            targets.AddTarget(shape.GetPath())

    def _one_sided(self) -> tuple[list[str], NDArray[np.float32], NDArray[np.float32]]:
        """Names, directions (K', 3V) and weights (T, K') >= 0 of all that some frame takes."""
        weights_m, along = np.concatenate(self._weights_m), self.directions
        sides = {"plus": 1, "minus": -1}
        names = [f"shape_{number:02d}_{side}" for side in sides for number in range(len(along))]
        directions = np.concatenate([sign * along for sign in sides.values()])
        sided_m = np.concatenate([(sign * weights_m).clip(0) for sign in sides.values()], axis=1)
        taken = np.flatnonzero(sided_m.any(axis=0))
        return [names[number] for number in taken], directions[taken], sided_m[:, taken]

    def _animate(
        self, animation: UsdSkel.Animation, local_m: NDArray[np.float64], weights: NDArray
    ) -> None:
        """Joints' places (24, 3) from their parents, turned as they move, and weights (T, K')."""
        pose, trans_m = unpack_theta(self._motion.theta)
        rotations = joint_rotations(self._body, pose)
        animation.CreateScalesAttr(Vt.Vec3hArray([Gf.Vec3h(1)] * rotations.shape[1]))
        moved, turned = animation.CreateTranslationsAttr(), animation.CreateRotationsAttr()
        blended = animation.CreateBlendShapeWeightsAttr()
        for time in range(len(pose)):
            here_m = local_m.copy()
            here_m[0] += trans_m[time]
            moved.Set(vectors(here_m), time)
            quaternions = Rotation.from_matrix(rotations[time]).as_quat()  # x, y, z, w
            turned.Set(Vt.QuatfArray([Gf.Quatf(w, x, y, z) for x, y, z, w in quaternions]), time)
            blended.Set(Vt.FloatArray.FromNumpy(weights[time].astype(np.float32)), time)

    def _bind_mesh(
        self, stage: Usd.Stage, path: str, skeleton: UsdSkel.Skeleton
    ) -> UsdSkel.BindingAPI:
        mesh = UsdGeom.Mesh.Get(stage, path)
        rest_m = self._shaped_m + self._mean_m.reshape(-1, 3)
        normals = VertexNormals(self._body.faces, self._body.vertex_count)
        mesh.CreatePointsAttr(vectors(rest_m))
        mesh.CreateNormalsAttr(vectors(normals(rest_m)))
        mesh.CreateExtentAttr(vectors(np.stack([rest_m.min(axis=0), rest_m.max(axis=0)])))
        binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
        binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
        binding.CreateGeomBindTransformAttr(Gf.Matrix4d(1))
        # Of each vertex the largest weights first, as many as any vertex has.
        weights = self._body.weights
        width = int((weights > 0).sum(axis=1).max())
        joints = np.argsort(-weights, axis=1, kind="stable")[:, :width]
        shares = np.take_along_axis(weights, joints, axis=1).astype(np.float32)
        indices = Vt.IntArray.FromNumpy(joints.astype(np.int32).ravel())
        binding.CreateJointIndicesPrimvar(False, width).Set(indices)
        binding.CreateJointWeightsPrimvar(False, width).Set(Vt.FloatArray.FromNumpy(shares.ravel()))
        return binding


def _joint_paths(parents: NDArray) -> Vt.TokenArray:
    """A body's joints by name, each below its parent: `pelvis/left_hip`."""
    paths: list[str] = []
    names, _ = SKELETONS[KIND_OF_JOINTS[len(parents)]]
    for name, parent in zip(names, parents, strict=True):
        paths.append(name if parent < 0 else f"{paths[parent]}/{name}")
    return Vt.TokenArray(paths)


def _translations(places_m: NDArray) -> Vt.Matrix4dArray:
    return Vt.Matrix4dArray([Gf.Matrix4d(1).SetTranslate(Gf.Vec3d(*p)) for p in places_m.tolist()])


def vectors(array: NDArray) -> Vt.Vec3fArray:
    """(N, 3) as USD has it, in float32."""
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(array, np.float32))
