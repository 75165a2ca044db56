"""BVH files of any skeleton: written here, so that no reader is tested by its own writer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.body.model_data import SMPL_PARENTS

AXES = "ZXY"


@dataclass(frozen=True)
class Skeleton:
    """Joints, parents first."""

    names: Sequence[str]
    parents: Sequence[int]
    rest: NDArray[np.floating]
    """(J, 3) in any unit."""


def world_of(pose: NDArray[np.floating]) -> NDArray[np.float64]:
    """World rotations (T, 24, 3, 3) of SMPL's joints of local ones (T, 22, 3)."""
    local = Rotation.from_rotvec(pose.reshape(-1, 3)).as_matrix().reshape(*pose.shape[:2], 3, 3)
    world = np.zeros((len(pose), 24, 3, 3))
    for joint, parent in enumerate(SMPL_PARENTS):
        own = local[:, joint] if joint < 22 else np.broadcast_to(np.eye(3), local[:, 0].shape)
        world[:, joint] = own if parent < 0 else world[:, parent] @ own
    return world


def text(
    skeleton: Skeleton,
    world: NDArray[np.floating],
    root: NDArray[np.floating],
    fps: float = 60.0,
    places: NDArray[np.floating] | None = None,
) -> str:
    """A file of world rotations (T, J, 3, 3) and places (T, 3) of the root.

    With `places` (T, J, 3), in their parents' frames, every joint has six channels.
    """
    hierarchy = _joint(skeleton, 0, "ROOT", six=places is not None)
    lines = ["HIERARCHY", *hierarchy, "MOTION", f"Frames: {len(root)}"]
    lines.append(f"Frame Time: {1 / fps:.9f}")
    order = _depth_first(skeleton, 0)
    columns = [root]
    for joint in order:
        parent = skeleton.parents[joint]
        before = world[:, parent] if parent >= 0 else np.eye(3)
        own = Rotation.from_matrix(np.swapaxes(before, -1, -2) @ world[:, joint])
        if places is not None and parent >= 0:
            columns.append(places[:, joint])
        columns.append(own.as_euler(AXES, degrees=True))
    rows = np.concatenate(columns, axis=1)
    return "\n".join([*lines, *(" ".join(f"{value:.9f}" for value in row) for row in rows), ""])


def _depth_first(skeleton: Skeleton, joint: int) -> list[int]:
    children = [child for child, parent in enumerate(skeleton.parents) if parent == joint]
    return [joint, *(one for child in children for one in _depth_first(skeleton, child))]


def _joint(skeleton: Skeleton, joint: int, kind: str, *, six: bool) -> list[str]:
    parent = skeleton.parents[joint]
    offset = skeleton.rest[joint] - (skeleton.rest[parent] if parent >= 0 else 0)
    turns = " ".join(f"{axis}rotation" for axis in AXES)
    places = "6 Xposition Yposition Zposition" if six or parent < 0 else "3"
    own = [f"{kind} {skeleton.names[joint]}", "{", f"OFFSET {' '.join(map(str, offset))}"]
    own.append(f"CHANNELS {places} {turns}")
    children = [child for child, parent in enumerate(skeleton.parents) if parent == joint]
    inner = [line for child in children for line in _joint(skeleton, child, "JOINT", six=six)]
    return [*own, *(inner or ["End Site", "{", "OFFSET 0 0.1 0", "}"]), "}"]
