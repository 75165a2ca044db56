"""glTF binary: SMPL's skeleton and weights, blend shapes for flesh, and the motion as an animation.

What browsers, engines and Blender play. The blend shapes belong to this motion
(`bridge.export.blend_shapes`); the largest error that they leave stands in the file's `extras`.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.posing import shaped_joints
from bridge.export.blend_shapes import BlendShapes
from bridge.export.mesh_files import VertexNormals
from bridge.export.output import about
from bridge.motion.smoothing import continuous_quaternions
from bridge.runtime.moving_body import MovingBody

_SET = 4
"""Joints of a vertex in one set: SMPL needs one; of several some players know the first alone."""
_TYPES = {np.dtype("f4"): 5126, np.dtype("u4"): 5125, np.dtype("u1"): 5121}
_WIDTHS = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class _Buffer:
    """Arrays one after another, each with its accessor."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.views: list[dict[str, int]] = []
        self.accessors: list[dict[str, Any]] = []
        self.size = 0

    def add(self, array: NDArray, *, bounds: bool = False) -> int:
        """The accessor of (N,) or (N, width) numbers; with their bounds where glTF wants them."""
        rows = np.ascontiguousarray(array).reshape(len(array), -1)
        stored = rows.tobytes()
        self.views.append({"buffer": 0, "byteOffset": self.size, "byteLength": len(stored)})
        said = {"min": rows.min(0).tolist(), "max": rows.max(0).tolist()} if bounds else {}
        kind = {"componentType": _TYPES[rows.dtype], "type": _WIDTHS[rows.shape[1]]}
        view = {"bufferView": len(self.views) - 1, "count": len(rows)}
        self.accessors.append({**view, **kind, **said})
        self.parts.append(stored + bytes(-len(stored) % 4))
        self.size += len(self.parts[-1])
        return len(self.accessors) - 1


def write(path: Path, moving: MovingBody) -> None:
    """Write one file: metres, y up, times in seconds from 0."""
    shapes, buffer, body = BlendShapes(moving), _Buffer(), moving.body
    joints_m = shaped_joints(body, moving.motion.betas[None])[0]
    bones = len(joints_m)
    bind = np.tile(np.eye(4), (bones, 1, 1))
    bind[:, 3, :3] = -joints_m  # glTF's matrices lie column by column
    skin = {"joints": [*range(bones)], "skeleton": 0, "inverseBindMatrices": buffer.add(_f4(bind))}
    extras = {"dsnet": {**about(moving), "largest_error_mm": 1e3 * shapes.error_m}}
    scene = {
        "asset": {"version": "2.0", "generator": "dsnet", "extras": extras},
        "scene": 0,
        "scenes": [{"nodes": [0, bones]}],
        "nodes": [*_bones(body, joints_m), {"name": "body", "mesh": 0, "skin": 0}],
        "meshes": [_mesh(buffer, body, shapes)],
        "skins": [skin],
        "animations": [_animation(buffer, moving, joints_m, shapes)],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": buffer.size}],
    }
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    whole = 12 + 8 + len(text) + 8 + buffer.size
    with path.open("wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, whole))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text)
        file.write(struct.pack("<I4s", buffer.size, b"BIN\0"))
        file.writelines(buffer.parts)


def _f4(array: NDArray) -> NDArray[np.float32]:
    return array.astype("f4")


def _bones(body: BodyModelData, joints_m: NDArray) -> list[dict[str, Any]]:
    """A node a joint, at rest."""
    nodes = []
    for number, (name, parent) in enumerate(zip(body.joint_names, body.parents, strict=True)):
        place_m = joints_m[number] - (joints_m[parent] if parent >= 0 else 0)
        children = [int(child) for child in np.flatnonzero(body.parents == number)]
        node = {"name": name, "translation": place_m.tolist()}
        nodes.append({**node, "children": children} if children else node)
    return nodes


def _mesh(buffer: _Buffer, body: BodyModelData, shapes: BlendShapes) -> dict[str, Any]:
    normals = VertexNormals(body.faces, body.vertex_count)
    attributes = {
        "POSITION": buffer.add(_f4(shapes.rest_m), bounds=True),
        "NORMAL": buffer.add(normals(shapes.rest_m)),
    }
    order = np.argsort(-body.weights, axis=1, kind="stable")
    shares = np.take_along_axis(body.weights, order, axis=1)
    for number, start in enumerate(range(0, (shares > 0).sum(axis=1).max(), _SET)):
        joints, share = (array[:, start : start + _SET] for array in (order, shares))
        attributes[f"JOINTS_{number}"] = buffer.add(np.where(share > 0, joints, 0).astype("u1"))
        attributes[f"WEIGHTS_{number}"] = buffer.add(_f4(share))
    primitive: dict[str, Any] = {
        "attributes": attributes,
        "indices": buffer.add(body.faces.astype("u4").ravel()),
    }
    mesh: dict[str, Any] = {"name": "body", "primitives": [primitive]}
    if shapes.names:
        added = [buffer.add(_f4(shape_m), bounds=True) for shape_m in shapes.shapes_m]
        primitive["targets"] = [{"POSITION": accessor} for accessor in added]
        mesh |= {"weights": [0.0] * len(added), "extras": {"targetNames": shapes.names}}
    return mesh


def _animation(
    buffer: _Buffer, moving: MovingBody, joints_m: NDArray, shapes: BlendShapes
) -> dict[str, Any]:
    time = buffer.add(_f4(np.arange(len(moving)) / moving.motion.fps), bounds=True)
    turns = continuous_quaternions(moving.pose)
    followed = [(0, "translation", joints_m[0] + moving.motion.trans_m)]
    for joint in range(turns.shape[1]):
        followed.append((joint, "rotation", turns[:, joint]))
    if shapes.names:
        followed.append((len(joints_m), "weights", shapes.weights.ravel()))
    samplers, channels = [], []
    for node, what, values in followed:
        channels.append({"sampler": len(samplers), "target": {"node": node, "path": what}})
        samplers.append({"input": time, "output": buffer.add(_f4(values))})
    return {"name": moving.motion.source.stem, "samplers": samplers, "channels": channels}
