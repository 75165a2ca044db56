"""The walk of `tests.forged.walks` as GLB, VRMA and FBX: written here, by no reader's library."""

from __future__ import annotations

import json
import struct
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from bridge.body.model_data import SMPL_PARENTS
from tests.forged.bvh import world_of
from tests.forged.walks import FPS, MIXAMO, REST_CM, Turns, about, named, walk

_OF_VRM = named(
    "hips,spine,chest,upperChest,neck,head",
    "UpperLeg,LowerLeg,Foot,Toes,Shoulder,UpperArm,LowerArm,Hand",
    "{side}{name}",
)
VRM = [name[0].lower() + name[1:] for name in _OF_VRM]
ODD: Turns = {n: about("x", 20.0 * n) @ about("z", 90.0 - 7 * n) for n in range(24)}
"""Frames of bones that lie like no other's."""
STANDS = {"first": 0, "moved": 40}
"""Frames of the walk; left and right are alike in the first."""
ORDERS = ("xyz", "xzy", "yzx", "yxz", "zxy", "zyx")
"""FBX's orders of rotation, by their numbers: the first turns first."""
_SECOND = 46186158000
"""Ticks of FBX."""


def local_walk(frames: Turns) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Turns of bones at rest (24, 3, 3) and places (24, 3), turns of the walk (T, 24, 3, 3), each
    in its parent's frame, and places of the root (T, 3); centimetres, y up."""
    pose, places_m = walk()
    own = np.stack([frames.get(n, np.eye(3)) for n in range(24)])
    world, rest = world_of(pose) @ own, own.copy()
    places, turns = REST_CM.copy(), world.copy()
    for joint, parent in enumerate(SMPL_PARENTS):
        if parent >= 0:
            rest[joint] = own[parent].T @ own[joint]
            places[joint] = own[parent].T @ (REST_CM[joint] - REST_CM[parent])
            turns[:, joint] = np.swapaxes(world[:, parent], -1, -2) @ world[:, joint]
    return rest, places, turns, 100 * places_m


def gltf(
    names: Sequence[str] = MIXAMO,
    frames: Turns = ODD,
    *,
    skin: bool = True,
    default: str = "rest",
    kind: str = "LINEAR",
    animations: Mapping[str, int] | None = None,
    **more: Any,
) -> tuple[dict[str, Any], bytes]:
    """What a file says, and its numbers, in metres.

    Parameters
    ----------
    skin : whether the joints are bound by one.
    default : how nodes stand without animation: as a key of `STANDS`, or at `rest`.
    animations : how many frames of the walk each has, by name.
    more : what else the file says.
    """
    rest, places, turns, root = local_walk(frames)
    quaternions = Rotation.from_matrix(turns.reshape(-1, 3, 3)).as_quat().reshape(-1, 24, 4)
    parts, views, accessors = list[bytes](), list[dict[str, int]](), list[dict[str, Any]]()

    def add(array: np.ndarray, type_: str) -> int:
        stored = array.astype("<f4").tobytes()
        views.append({"buffer": 0, "byteOffset": sum(map(len, parts)), "byteLength": len(stored)})
        parts.append(stored)
        accessors.append({"bufferView": len(views) - 1, "componentType": 5126, "type": type_,
                          "count": len(array)})  # fmt: skip
        return len(accessors) - 1

    def keys(array: np.ndarray) -> np.ndarray:
        """With tangents of nothing before and after each."""
        none = np.zeros_like(array)
        spline = np.stack([none, array, none], axis=1).reshape(-1, array.shape[1])
        return spline if kind == "CUBICSPLINE" else array

    stands = (
        Rotation.from_matrix(rest).as_quat() if default == "rest" else quaternions[STANDS[default]]
    )
    nodes: list[dict[str, Any]] = [
        {"name": name, "rotation": stands[n].tolist(), "translation": (places[n] / 100).tolist(),
         "children": [child for child, parent in enumerate(SMPL_PARENTS) if parent == n]}
        for n, name in enumerate(names)
    ]  # fmt: skip
    said: dict[str, Any] = {"asset": {"version": "2.0"}, "nodes": nodes, **more}
    if skin:
        bind = np.tile(np.eye(4), (24, 1, 1))
        bind[:, :3, :3] = [frames.get(n, np.eye(3)) for n in range(24)]
        bind[:, :3, 3] = REST_CM / 100
        inverse = np.linalg.inv(bind).swapaxes(1, 2).reshape(24, 16)
        said["skins"] = [{"joints": [*range(24)], "inverseBindMatrices": add(inverse, "MAT4")}]
        said["nodes"] = [*nodes, {"name": "body", "mesh": 0, "skin": 0}]
    said["animations"] = []
    for name, count in (animations or {"walk": len(root)}).items():
        time = add(np.arange(count)[:, None] / FPS, "SCALAR")
        moved = [(n, "rotation", quaternions[:count, n]) for n in range(24)]
        moved.append((0, "translation", root[:count] / 100))
        samplers = [
            {"input": time, "interpolation": kind,
             "output": add(keys(values), "VEC4" if what == "rotation" else "VEC3")}
            for _, what, values in moved
        ]  # fmt: skip
        channels = [
            {"sampler": n, "target": {"node": node, "path": what}}
            for n, (node, what, _) in enumerate(moved)
        ]
        if count:
            whole = {"name": name, "samplers": samplers, "channels": channels}
            said["animations"].append(whole)
    binary = b"".join(parts)
    return said | {"accessors": accessors, "bufferViews": views,
                   "buffers": [{"byteLength": len(binary)}]}, binary  # fmt: skip


def glb(said: dict[str, Any], binary: bytes) -> bytes:
    """The file of both."""
    text = json.dumps(said).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIII4s", b"glTF", 2, 28 + len(text) + len(binary), len(text), b"JSON")
    return head + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary


def vrma() -> bytes:
    """Bones that the extension names, on nodes of other names, which stand in a T."""
    bones = {name: {"node": n} for n, name in enumerate(VRM[:22])}
    extensions = {"VRMC_vrm_animation": {"humanoid": {"humanBones": bones}}}
    return glb(*gltf([f"bone {n}" for n in range(24)], {}, skin=False, extensions=extensions))


def fbx(
    names: Sequence[str] = MIXAMO,
    *,
    bind: bool = True,
    default: str = "moved",
    takes: Mapping[str, int] | None = None,
    up: str = "y",
    unit_cm: float = 1.0,
) -> str:
    """A file of text: bones with pre-rotations, in all orders of rotation.

    Parameters
    ----------
    bind : whether it has a bind pose.
    default : how bones stand without animation: as a key of `STANDS`, or at `rest`.
    takes : how many frames of the walk each has, by name.
    unit_cm : the unit that it states and is in.
    """
    rest, places, turns, root = local_walk(ODD)
    outer = np.eye(3) if up == "y" else about("x", 90)
    rest[0], turns[:, 0], root = outer @ rest[0], outer @ turns[:, 0], root @ outer.T
    places, root = places / unit_cm, root / unit_cm
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Gimbal lock")  # any angles of a rotation do
        before = Rotation.from_matrix(rest).as_euler("xyz", degrees=True)
    # What is left to Lcl Rotation, whose order is the joint's own.
    left = np.swapaxes(Rotation.from_euler("xyz", before, degrees=True).as_matrix(), -1, -2) @ turns
    angles = np.stack(
        [_euler(left[:, n], ORDERS[n % len(ORDERS)]) for n in range(len(names))], axis=1
    )
    world = [outer @ ODD[n] for n in range(24)]
    lines, links = list[str](), list[str]()
    for n, name in enumerate(names):
        stands = np.zeros(3) if default == "rest" else angles[STANDS[default], n]
        lines.append(_model(n, name, places[n], before[n], stands))
        links.append(f'C: "OO",{100 + n},{100 + SMPL_PARENTS[n] if n else 0}')
        links.append(f'C: "OO",{300 + n},{100 + n}')
    if bind:
        lines.append(_pose(world, (outer @ REST_CM.T).T / unit_cm))
    identity = 1000
    for number, (take, count) in enumerate((takes or {"Take 001": len(root)}).items()):
        stack, layer = 500 + 2 * number, 501 + 2 * number
        end = round((count - 1) / FPS * _SECOND)
        lines += [f'AnimationStack: {stack}, "AnimStack::{take}", "" {{ Properties70: {{',
                  'P: "LocalStart", "KTime", "Time", "",0',
            f'P: "LocalStop", "KTime", "Time", "",{end}', "} }",
                  f'AnimationLayer: {layer}, "AnimLayer::Base", "" {{ }}']  # fmt: skip
        links.append(f'C: "OO",{layer},{stack}')
        moved = [(n, "R", "Lcl Rotation", angles[:count, n]) for n in range(24)]
        for n, letter, what, values in [*moved, (0, "T", "Lcl Translation", root[:count])]:
            lines.append(f'AnimationCurveNode: {identity}, "AnimCurveNode::{letter}", "" {{ }}')
            links += [f'C: "OO",{identity},{layer}', f'C: "OP",{identity},{100 + n}, "{what}"']
            for axis in range(3):
                curve = identity + 1 + axis
                lines.append(_curve(curve, values[:, axis]))
                links.append(f'C: "OP",{curve},{identity}, "d|{"XYZ"[axis]}"')
            identity += 4
    settings = {"UpAxis": "XYZ".index(up.upper()), "UpAxisSign": 1, "CoordAxis": 0,
                "CoordAxisSign": 1, "FrontAxis": 2 if up == "y" else 1, "UnitScaleFactor": unit_cm,
                "FrontAxisSign": 1 if up == "y" else -1, "TimeMode": 3}  # fmt: skip
    stated = "\n".join(f'P: "{name}", "int", "", "",{value}' for name, value in settings.items())
    return "\n".join([
        "; FBX 7.4.0 project file", "FBXHeaderExtension:  { FBXVersion: 7400 }",
        f"GlobalSettings:  {{ Version: 1000\nProperties70:  {{\n{stated}\n}} }}",
        "Objects:  {", *lines, "}", "Connections:  {", *links, "}", "",
    ])  # fmt: skip


def _euler(turns: np.ndarray, order: str) -> np.ndarray:
    """(T, 3) degrees about x, y, z."""
    angles = Rotation.from_matrix(turns).as_euler(order)
    angles = np.degrees(np.unwrap(angles, axis=0))
    return angles[:, ["".join(order).index(axis) for axis in "xyz"]]


def _model(
    number: int, name: str, place: np.ndarray, before: np.ndarray, stands: np.ndarray
) -> str:
    def vector(what: str, values: np.ndarray) -> str:
        return f'P: "{what}", "{what}", "", "A",{",".join(f"{value:.9f}" for value in values)}'

    return "\n".join([
        f'Model: {100 + number}, "Model::{name}", "LimbNode" {{ Properties70: {{',
        f'P: "RotationOrder", "enum", "", "",{number % len(ORDERS)}',
        'P: "RotationActive", "bool", "", "",1', vector("PreRotation", before),
        vector("Lcl Translation", place), vector("Lcl Rotation", stands), "} }",
        f'NodeAttribute: {300 + number}, "NodeAttribute::{name}", "LimbNode" {{ TypeFlags: '
        '"Skeleton" }',
    ])  # fmt: skip


def _pose(turns: Sequence[np.ndarray], places: np.ndarray) -> str:
    lines = ['Pose: 490, "Pose::BIND", "BindPose" { Type: "BindPose"']
    for number, (turn, place) in enumerate(zip(turns, places, strict=True)):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = turn, place
        numbers = ",".join(f"{value:.9f}" for value in matrix.T.ravel())  # column by column
        lines.append(f"PoseNode: {{ Node: {100 + number}\nMatrix: *16 {{ a: {numbers} }} }}")
    return "\n".join([*lines, "}"])


def _curve(number: int, values: np.ndarray) -> str:
    times = ",".join(str(round(n / FPS * _SECOND)) for n in range(len(values)))
    numbers = ",".join(f"{value:.6f}" for value in values)
    count = len(values)
    return "\n".join([
        f'AnimationCurve: {number}, "AnimCurve::", "" {{ KeyVer: 4008',
        f"KeyTime: *{count} {{ a: {times} }}", f"KeyValueFloat: *{count} {{ a: {numbers} }}",
        "KeyAttrFlags: *1 { a: 4 }", "KeyAttrDataFloat: *4 { a: 0,0,0,0 }",
        f"KeyAttrRefCount: *1 {{ a: {count} }}", "}",
    ])  # fmt: skip
