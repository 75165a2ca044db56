"""The moving body as UsdSkel has it: SMPL's skeleton and weights, and blend shapes for the rest.

Joint rotations and skinning weights are SMPL's, exactly. What SMPL and the predictor add before
skinning becomes blend shapes with a weight a frame (`blend_shapes`): for each direction one shape
along it and one against it, scaled so that weights stay within 0 and 1, for Blender cuts off what
is below. The largest error that this makes is written into the prim's custom data.
"""

# USD's modules are compiled and come without types.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt
from scipy.spatial.transform import Rotation

from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.posing import joint_rotations, shaped_joints
from bridge.export.blend_shapes import RestBodies, fit_blend_shapes
from bridge.export.surface_frames import VertexNormals
from bridge.motion import unpack_theta
from bridge.runtime.moving_body import MovedFrames, MovingBody


class SkeletonVariant:
    """Gathers a moving body's frames, and writes them as a skeleton with blend shapes."""

    def __init__(self, moving: MovingBody) -> None:
        self._moving, self._body = moving, moving.body
        self._rest = RestBodies(moving)
        self._shapes = fit_blend_shapes(moving, self._rest)
        self._weights_m: list[NDArray[np.float32]] = []
        self.error_m = 0.0
        """Largest distance of a vertex from the predicted one in the rest pose so far, metres."""

    def add(self, posed: MovedFrames) -> None:
        """The next frames: their weights, and the error that is left."""
        moved_m = self._rest(posed)
        weights_m = self._shapes.weights_m(moved_m)
        self._weights_m.append(weights_m)
        self.error_m = max(self.error_m, self._shapes.error_m(moved_m, weights_m))

    def write(self, stage: Usd.Stage, root: str, mesh: str) -> None:
        """Define the skeleton below `root`, and bind `mesh`, where the stage is edited now."""
        names, directions, weights_m = self._one_sided()
        reach_m = weights_m.max(axis=0)
        skel_root = UsdSkel.Root.Define(stage, root)
        skel_root.GetPrim().SetCustomDataByKey("largest_error_mm", 1e3 * self.error_m)
        skeleton = self._write_skeleton(stage, f"{root}/Skeleton")
        animation = self._write_animation(stage, f"{root}/Animation", names, weights_m / reach_m)
        UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
        UsdSkel.BindingAPI(skeleton).CreateAnimationSourceRel().SetTargets([animation.GetPath()])
        binding = self._bind_mesh(stage, mesh, skeleton)
        binding.CreateBlendShapesAttr(Vt.TokenArray(names))
        targets = binding.CreateBlendShapeTargetsRel()
        for name, direction, reach in zip(names, directions, reach_m, strict=True):
            shape = UsdSkel.BlendShape.Define(stage, f"{mesh}/{name}")
            shape.CreateOffsetsAttr(_vectors(direction.reshape(-1, 3) * reach))
            targets.AddTarget(shape.GetPath())

    def _one_sided(self) -> tuple[list[str], NDArray[np.float32], NDArray[np.float32]]:
        """Names, directions (K', 3V) and weights (T, K') >= 0 of all that some frame takes."""
        weights_m, along = np.concatenate(self._weights_m), self._shapes.directions
        sides = {"plus": 1, "minus": -1}
        names = [f"shape_{number:02d}_{side}" for side in sides for number in range(len(along))]
        directions = np.concatenate([sign * along for sign in sides.values()])
        sided_m = np.concatenate([(sign * weights_m).clip(0) for sign in sides.values()], axis=1)
        taken = np.flatnonzero(sided_m.any(axis=0))
        return [names[number] for number in taken], directions[taken], sided_m[:, taken]

    @property
    def _joints_m(self) -> NDArray[np.float64]:
        return shaped_joints(self._body, self._moving.motion.betas[None])[0]

    @property
    def _local_m(self) -> NDArray[np.float64]:
        """(24, 3) each joint from its parent in the rest pose."""
        joints_m, parents = self._joints_m, self._body.parents
        return joints_m - np.where(parents[:, None] < 0, 0.0, joints_m[parents])

    def _write_skeleton(self, stage: Usd.Stage, path: str) -> UsdSkel.Skeleton:
        skeleton = UsdSkel.Skeleton.Define(stage, path)
        skeleton.CreateJointsAttr(joint_paths(self._body.parents))
        skeleton.CreateBindTransformsAttr(_translations(self._joints_m))
        skeleton.CreateRestTransformsAttr(_translations(self._local_m))
        return skeleton

    def _write_animation(
        self, stage: Usd.Stage, path: str, names: list[str], weights: NDArray
    ) -> UsdSkel.Animation:
        pose, trans_m = unpack_theta(self._moving.motion.theta)
        rotations = joint_rotations(self._body, pose)
        count, local_m = rotations.shape[1], self._local_m
        animation = UsdSkel.Animation.Define(stage, path)
        animation.CreateJointsAttr(joint_paths(self._body.parents))
        animation.CreateBlendShapesAttr(Vt.TokenArray(names))
        animation.CreateScalesAttr(Vt.Vec3hArray([Gf.Vec3h(1)] * count))
        moved, turned = animation.CreateTranslationsAttr(), animation.CreateRotationsAttr()
        blended = animation.CreateBlendShapeWeightsAttr()
        for time in range(len(pose)):
            here_m = local_m.copy()
            here_m[0] += trans_m[time]
            moved.Set(_vectors(here_m), time)
            quaternions = Rotation.from_matrix(rotations[time]).as_quat()  # x, y, z, w
            turned.Set(Vt.QuatfArray([Gf.Quatf(w, x, y, z) for x, y, z, w in quaternions]), time)
            blended.Set(Vt.FloatArray.FromNumpy(weights[time].astype(np.float32)), time)
        return animation

    def _bind_mesh(
        self, stage: Usd.Stage, path: str, skeleton: UsdSkel.Skeleton
    ) -> UsdSkel.BindingAPI:
        mesh = UsdGeom.Mesh.Get(stage, path)
        rest_m = self._rest.shaped_m + self._shapes.mean_m.reshape(-1, 3)
        normals = VertexNormals(self._body.faces, self._body.vertex_count)
        mesh.CreatePointsAttr(_vectors(rest_m))
        mesh.CreateNormalsAttr(_vectors(normals(rest_m)))
        mesh.CreateExtentAttr(_vectors(np.stack([rest_m.min(axis=0), rest_m.max(axis=0)])))
        binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
        binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
        binding.CreateGeomBindTransformAttr(Gf.Matrix4d(1))
        joints, weights = largest_weights(self._body.weights)
        width = joints.shape[1]
        indices = binding.CreateJointIndicesPrimvar(False, width)
        indices.Set(Vt.IntArray.FromNumpy(joints.astype(np.int32).ravel()))
        shares = binding.CreateJointWeightsPrimvar(False, width)
        shares.Set(Vt.FloatArray.FromNumpy(weights.astype(np.float32).ravel()))
        return binding


def joint_paths(parents: NDArray) -> Vt.TokenArray:
    """SMPL's joints by name, each below its parent: `pelvis/left_hip`."""
    paths: list[str] = []
    for name, parent in zip(SMPL_JOINT_NAMES, parents, strict=True):
        paths.append(name if parent < 0 else f"{paths[parent]}/{name}")
    return Vt.TokenArray(paths)


def largest_weights(weights: NDArray) -> tuple[NDArray, NDArray]:
    """Joints and weights (V, N) of each vertex, the largest first; N is as many as any has."""
    width = int((weights > 0).sum(axis=1).max())
    joints = np.argsort(-weights, axis=1, kind="stable")[:, :width]
    return joints, np.take_along_axis(weights, joints, axis=1)


def _translations(places_m: NDArray) -> Vt.Matrix4dArray:
    return Vt.Matrix4dArray([Gf.Matrix4d(1).SetTranslate(Gf.Vec3d(*p)) for p in places_m.tolist()])


def _vectors(array: NDArray) -> Vt.Vec3fArray:
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(array, np.float32))
