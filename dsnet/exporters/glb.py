"""glTF binary: SMPL's skeleton and weights, blend shapes for soft tissue, and an animation.

Browsers, engines and Blender play it. The blend shapes are fitted to this motion (`BlendShapes`);
the file's `extras` have their largest error. An embedded body has a material with its picture of
skin. glTF has one place on a picture for each vertex, so vertices on seams are there several times:
the body's own come first; of which the others are copies stands in the mesh's `extras`.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.posing import joint_rotations, pose_features, shaped_joints, shaped_vertices
from bridge.body.skin import ROUGHNESS, SplitMesh, split_at_seams
from bridge.body.surface_operators import vertex_normals
from bridge.motion.smoothing import continuous_quaternions
from dsnet.exporters.output import export_facts
from dsnet.prediction.moving_body import MovedFrames, MovingBody

FRAMES_FITTED = 256
"""Most frames, evenly spaced, to which the directions are fitted."""
MOST_SHAPES = 64
"""Most directions, as engines grow slow with more. A direction has two blend shapes."""
ENOUGH_M = 2e-4
"""Largest error of a vertex in the fitted frames at which no more directions are added."""
_LINEAR, _BY_MIPMAPS, _CLAMPED = 9729, 9987, 33071
_SET = 4
"""Joints of a vertex in one set: SMPL needs one set; some players read only the first."""
_TYPES = {np.dtype("f4"): 5126, np.dtype("u4"): 5125, np.dtype("u1"): 5121}
_WIDTHS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class BlendShapes:
    """Pose blend shapes and skin offsets of one motion as few blend shapes.

    Both are some ten thousand numbers a frame, but few of their directions matter in one motion.
    Of each principal direction there are two blend shapes, with opposite signs, scaled so that
    weights are within 0 and 1, as Blender clips negative ones. The motion is predicted twice: to
    fit the directions, and for their weights.

    Attributes
    ----------
    rest_m : (V, 3) the mesh that the shapes are added to, before skinning.
    names, shapes_m, weights : of K shapes; (K, V, 3) and (T, K), 0 to 1.
    error_m : the largest error of a vertex, before skinning.
    """

    def __init__(self, moving: MovingBody) -> None:
        self._body, self._pose = moving.body, moving.pose
        posedirs = self._body.posedirs
        self._posedirs = posedirs.reshape(-1, posedirs.shape[-1]).T.astype(np.float32)
        self._fit(moving)
        shaped_m = shaped_vertices(self._body, moving.motion.betas[None])[0]
        self.rest_m = shaped_m + self._mean_m.reshape(-1, 3)
        self.error_m, coefficients_m = 0.0, []
        for posed in moving.shown("shapes"):
            moved_m = self.displaced_m(posed)
            coefficients_m.append(self._coefficients_m(moved_m))
            self.error_m = max(self.error_m, self._error_m(moved_m, coefficients_m[-1]))
        shapes = self._one_sided(np.concatenate(coefficients_m))
        self.names, self.shapes_m, self.weights = shapes

    def _fit(self, moving: MovingBody) -> None:
        """Find the mean (3V,) and as many directions (K, 3V), orthonormal, as the frames need."""
        chosen = np.linspace(0, len(moving) - 1, min(FRAMES_FITTED, len(moving)))
        chosen, kept = chosen.round().astype(int), []
        for posed in moving:
            inside = chosen[(chosen >= posed.frames.start) & (chosen < posed.frames.stop)]
            kept.append(self.displaced_m(posed)[inside - posed.frames.start])
        frames_m = np.concatenate(kept)
        self._mean_m = frames_m.mean(axis=0)
        _, size, directions = np.linalg.svd(frames_m - self._mean_m, full_matrices=False)
        # Leave out directions that are only rounding errors.
        directions = directions[: np.count_nonzero(size > 1e-6 * max(size[0], 1e-9))]
        self.directions = directions[:MOST_SHAPES]
        coefficients_m = self._coefficients_m(frames_m)
        for count in range(1, len(self.directions)):
            if self._error_m(frames_m, coefficients_m[:, :count]) <= ENOUGH_M:
                self.directions = self.directions[:count]
                return

    def displaced_m(self, posed: MovedFrames) -> NDArray[np.float32]:
        """Displacements (T', 3V) of the shaped body before skinning, metres."""
        turns = joint_rotations(self._body, self._pose[posed.frames])
        features = pose_features(turns).astype(np.float32)
        moved_m = posed.offsets_m.reshape(len(posed), -1).copy()
        moved_m += features @ self._posedirs
        return moved_m

    def _coefficients_m(self, moved_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Coefficients (T', K) of displacements (T', 3V) by the directions."""
        return np.asarray((moved_m - self._mean_m) @ self.directions.T, np.float32)

    def _error_m(self, moved_m: NDArray[np.float32], coefficients_m: NDArray[np.float32]) -> float:
        """Largest error of a vertex with coefficients (T', K') of the first directions."""
        rebuilt_m = coefficients_m @ self.directions[: coefficients_m.shape[1]]
        error_m = moved_m - self._mean_m - rebuilt_m
        return float(np.linalg.norm(error_m.reshape(len(moved_m), -1, 3), axis=-1).max())

    def _one_sided(
        self, coefficients_m: NDArray[np.float32]
    ) -> tuple[list[str], NDArray[np.float32], NDArray[np.float32]]:
        """Names, shapes and weights of the blend shapes that some frame uses."""
        sides = {"plus": 1, "minus": -1}
        count = len(self.directions)
        names = [f"shape_{number:02d}_{side}" for side in sides for number in range(count)]
        sided_m = np.concatenate(
            [(sign * coefficients_m).clip(0) for sign in sides.values()], axis=1
        )
        used, largest_m = np.flatnonzero(sided_m.any(axis=0)), sided_m.max(axis=0)
        directions = np.concatenate([sign * self.directions for sign in sides.values()])[used]
        shapes_m = (directions * largest_m[used, None]).reshape(len(used), *self.rest_m.shape)
        return [names[n] for n in used], shapes_m, sided_m[:, used] / largest_m[used]


class _Buffer:
    """glTF's one buffer: arrays one after another, each with a view and an accessor."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.views: list[dict[str, int]] = []
        self.accessors: list[dict[str, Any]] = []
        self.size = 0

    def add(self, array: NDArray, *, bounds: bool = False) -> int:
        """Append (N,) or (N, width) numbers, with `bounds` if glTF needs them; gives the accessor.

        float64 is stored as float32.
        """
        rows = np.ascontiguousarray(array).reshape(len(array), -1)
        rows = rows.astype("f4") if rows.dtype == "f8" else rows
        limits = {"min": rows.min(0).tolist(), "max": rows.max(0).tolist()} if bounds else {}
        kind = {"componentType": _TYPES[rows.dtype], "type": _WIDTHS[rows.shape[1]]}
        view = {"bufferView": self.view(rows.tobytes()), "count": len(rows)}
        self.accessors.append({**view, **kind, **limits})
        return len(self.accessors) - 1

    def view(self, stored: bytes) -> int:
        """Append bytes; gives the number of their view."""
        self.views.append({"buffer": 0, "byteOffset": self.size, "byteLength": len(stored)})
        self.parts.append(stored + bytes(-len(stored) % 4))
        self.size += len(self.parts[-1])
        return len(self.views) - 1


def write(path: Path, moving: MovingBody) -> None:
    """Write one file: metres, y up, times in seconds from 0."""
    shapes, buffer, body = BlendShapes(moving), _Buffer(), moving.body
    joints_m = shaped_joints(body, moving.motion.betas[None])[0]
    bones = len(joints_m)
    bind = np.tile(np.eye(4), (bones, 1, 1))
    bind[:, 3, :3] = -joints_m  # glTF's matrices lie column by column
    skin = {"joints": [*range(bones)], "skeleton": 0, "inverseBindMatrices": buffer.add(bind)}
    extras = {"dsnet": {**export_facts(moving), "largest_error_mm": 1e3 * shapes.error_m}}
    # Blender drops what the asset says; of the mesh it makes properties (`dsnet.blender`).
    facts = {"betas": moving.motion.betas.tolist(), "flesh": bool(moving.gains.of_parts.any())}
    png, split, skinned = moving.skin_png, None, {}
    if png is not None and body.texture is not None:
        split, skinned = split_at_seams(body.faces, body.texture), _material(buffer, png)
        facts["copies_of"] = split.vertex[body.vertex_count :].tolist()
    scene = {
        "asset": {"version": "2.0", "generator": "dsnet", "extras": extras},
        "scene": 0,
        "scenes": [{"nodes": [0, bones]}],
        "nodes": [*_bones(body, joints_m), {"name": "body", "mesh": 0, "skin": 0}],
        "meshes": [_mesh(buffer, body, shapes, split, {"dsnet": facts})],
        "skins": [skin],
        "animations": [_animation(buffer, moving, joints_m, shapes)],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": buffer.size}],
        **skinned,
    }
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    whole = 12 + 8 + len(text) + 8 + buffer.size
    with path.open("wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, whole))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text)
        file.write(struct.pack("<I4s", buffer.size, b"BIN\0"))
        file.writelines(buffer.parts)


def _bones(body: BodyModelData, joints_m: NDArray) -> list[dict[str, Any]]:
    """A glTF node for each joint, in the rest pose."""
    nodes = []
    for number, (name, parent) in enumerate(zip(body.joint_names, body.parents, strict=True)):
        place_m = joints_m[number] - (joints_m[parent] if parent >= 0 else 0)
        children = [int(child) for child in np.flatnonzero(body.parents == number)]
        node = {"name": name, "translation": place_m.tolist()}
        nodes.append({**node, "children": children} if children else node)
    return nodes


def _material(buffer: _Buffer, png: bytes) -> dict[str, Any]:
    """The scene's entries for a material that is a picture of skin."""
    look = {"baseColorTexture": {"index": 0}, "metallicFactor": 0, "roughnessFactor": ROUGHNESS}
    filters = {"magFilter": _LINEAR, "minFilter": _BY_MIPMAPS, "wrapS": _CLAMPED, "wrapT": _CLAMPED}
    return {
        "materials": [{"name": "skin", "pbrMetallicRoughness": look}],
        "textures": [{"source": 0, "sampler": 0}],
        "images": [{"name": "skin", "bufferView": buffer.view(png), "mimeType": "image/png"}],
        "samplers": [filters],
    }


def _mesh(
    buffer: _Buffer,
    body: BodyModelData,
    shapes: BlendShapes,
    split: SplitMesh | None,
    extras: dict[str, Any],
) -> dict[str, Any]:
    """The mesh; of one that is split at its texture's seams the copies follow the vertices."""
    faces, vertex = body.faces, np.arange(body.vertex_count)
    if split is not None:
        faces, vertex = split.faces, split.vertex
    attributes = {
        "POSITION": buffer.add(shapes.rest_m[vertex], bounds=True),
        "NORMAL": buffer.add(vertex_normals(shapes.rest_m, body.faces)[vertex]),
    }
    order = np.argsort(-body.weights, axis=1, kind="stable")
    sorted_weights = np.take_along_axis(body.weights, order, axis=1)
    for number, start in enumerate(range(0, (sorted_weights > 0).sum(axis=1).max(), _SET)):
        joints, weights = (array[vertex, start : start + _SET] for array in (order, sorted_weights))
        attributes[f"JOINTS_{number}"] = buffer.add(np.where(weights > 0, joints, 0).astype("u1"))
        attributes[f"WEIGHTS_{number}"] = buffer.add(weights)
    primitive: dict[str, Any] = {
        "attributes": attributes,
        "indices": buffer.add(faces.astype("u4").ravel()),
    }
    if split is not None:  # glTF counts from the upper left
        attributes["TEXCOORD_0"] = buffer.add(split.places * [1, -1] + [0, 1])
        primitive["material"] = 0
    mesh: dict[str, Any] = {"name": "body", "primitives": [primitive], "extras": extras}
    if shapes.names:
        targets = [buffer.add(shape_m[vertex], bounds=True) for shape_m in shapes.shapes_m]
        primitive["targets"] = [{"POSITION": accessor} for accessor in targets]
        mesh |= {"weights": [0.0] * len(targets), "extras": {**extras, "targetNames": shapes.names}}
    return mesh


def _animation(
    buffer: _Buffer, moving: MovingBody, joints_m: NDArray, shapes: BlendShapes
) -> dict[str, Any]:
    time = buffer.add(np.arange(len(moving)) / moving.motion.fps, bounds=True)
    quaternions = continuous_quaternions(moving.pose)
    animated = [(0, "translation", joints_m[0] + moving.motion.trans_m)]
    for joint in range(quaternions.shape[1]):
        animated.append((joint, "rotation", quaternions[:, joint]))
    if shapes.names:
        animated.append((len(joints_m), "weights", shapes.weights.ravel()))
    samplers, channels = [], []
    for node, what, values in animated:
        channels.append({"sampler": len(samplers), "target": {"node": node, "path": what}})
        samplers.append({"input": time, "output": buffer.add(values)})
    return {"name": moving.motion.source.stem, "samplers": samplers, "channels": channels}
