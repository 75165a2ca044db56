"""What a BVH file holds, read by pybvh and checked: a skeleton at rest, and how it moves."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.errors import DsnetError
from bridge.motion.bounds import MOST_FRAMES, RATES_HZ
from bridge.motion.bvh_channels import PlainBvh
from bridge.runs.untrusted import damage_refused, open_regular

if TYPE_CHECKING:
    from pybvh import Bvh

_MOST_BYTES = 64 << 20
"""A minute of fifty joints at 120 Hz takes a fifth of it."""
_MOST_JOINTS = 512
_FRAMES_AT_ONCE = 2048


@dataclass(frozen=True, eq=False)
class BvhFile:
    """A skeleton of J joints and its motion of T frames, in the file's own unit and axes."""

    path: Path
    names: tuple[str, ...]
    """Of the joints, parents first."""
    parents: tuple[int, ...]
    """Of each joint; -1 of the root."""
    rest: NDArray[np.float64]
    """(J, 3) places where every rotation is none; the root's is its offset."""
    axes: tuple[str, ...]
    """Of each joint the order of its turns, such as `ZXY`: each about the axes that it then has."""
    angles_rad: NDArray[np.float64]
    """(T, J, 3) in that order."""
    root: NDArray[np.float64]
    """(T, 3) place of the root."""
    places: Mapping[int, NDArray[np.float64]]
    """(T, 3) by joint below the root that has them: its place in its parent's frame."""
    fps: float
    """Frames per second."""

    def blocks(self) -> Iterator[tuple[slice, NDArray[np.float64], NDArray[np.float64]]]:
        """Frames, rotations (B, J, 3, 3) and places (B, J, 3) of the joints in the file's world."""
        for start in range(0, len(self.root), _FRAMES_AT_ONCE):
            frames = slice(start, min(start + _FRAMES_AT_ONCE, len(self.root)))
            yield frames, *self._posed(frames)

    def _posed(self, frames: slice) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        angles = self.angles_rad[frames]
        turns = np.empty((*angles.shape[:2], 3, 3))
        places = np.empty(angles.shape)
        for joint, (parent, axes) in enumerate(zip(self.parents, self.axes, strict=True)):
            own = Rotation.from_euler(axes, angles[:, joint]).as_matrix()
            if parent < 0:
                turns[:, joint], places[:, joint] = own, self.root[frames]
                continue
            turns[:, joint] = turns[:, parent] @ own
            bone = np.broadcast_to(self.rest[joint] - self.rest[parent], (len(angles), 3))
            bone = self.places[joint][frames] if joint in self.places else bone
            places[:, joint] = places[:, parent] + np.einsum("txy,ty->tx", turns[:, parent], bone)
        return turns, places


def read_bvh_file(path: Path) -> BvhFile:
    """Read and check one file.

    Raises
    ------
    DsnetError
        If the file is missing, is no BVH, or holds no usable motion.
    """
    if path.suffix != ".bvh":  # pybvh reads no `.BVH`, as which Windows writes many a file
        raise unusable(path, "whose name does not end in small letters", "Rename it to .bvh.")
    # It draws too, and so takes half a second to import.
    from pybvh.bvhnode import BvhJoint

    with damage_refused(partial(_unreadable, path), RecursionError):
        with open_regular(path, _MOST_BYTES) as file:
            plain = PlainBvh.of(file.read().decode(errors="replace").splitlines(keepends=True))
        read = _read_plain(path, plain)
        joints = [node for node in read.nodes if isinstance(node, BvhJoint)]
        place = {id(node): number for number, node in enumerate(joints)}
        parents = tuple(-1 if n.parent is None else place[id(n.parent)] for n in joints)
        found = BvhFile(
            path=path,
            names=tuple(node.name for node in joints),
            parents=parents,
            rest=_rest(np.array([node.offset for node in joints], np.float64), parents),
            axes=tuple("".join(node.rot_channels) for node in joints),
            angles_rad=np.asarray(read.joint_angles, np.float64),
            root=np.asarray(read.root_pos, np.float64),
            places={
                number: plain.places[node.name]
                for number, node in enumerate(joints)
                if node.name in plain.places
            },
            fps=1.0 / read.frame_time,
        )
    _check(found)
    return found


def _read_plain(path: Path, plain: PlainBvh) -> Bvh:
    """By pybvh, which reads files alone."""
    import pybvh

    if not plain.places:
        return pybvh.read_bvh_file(path, world_up="+y")
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / path.name
        copy.write_text("".join(plain.lines), encoding="utf-8")
        return pybvh.read_bvh_file(copy, world_up="+y")


def _unreadable(path: Path, error: Exception) -> DsnetError:
    if isinstance(error, FileNotFoundError):
        return unusable(path, "which does not exist", "Check the path.")
    if isinstance(error, IsADirectoryError):
        return unusable(path, "which is a folder", "Name one file in it.")
    return unusable(path, f"which does not load ({str(error)[:200]})")


def unusable(path: Path, flaw: str, remedy: str = "") -> DsnetError:
    """The line that says why a file is refused."""
    usual = "Export it with three rotations on every joint, and three positions on the root."
    return DsnetError(f"{path}, {flaw}", "a BVH motion of a person", remedy or usual)


def _rest(offsets: NDArray[np.float64], parents: tuple[int, ...]) -> NDArray[np.float64]:
    places = offsets.copy()
    for joint, parent in enumerate(parents):
        if parent >= 0:
            places[joint] += places[parent]
    return places


def _check(found: BvhFile) -> None:
    frames, joints = found.angles_rad.shape[:2]
    if frames > MOST_FRAMES or joints > _MOST_JOINTS:
        flaw = f"{frames} frames of {joints} joints"
        raise unusable(
            found.path,
            flaw,
            f"At most {MOST_FRAMES} of {_MOST_JOINTS}: cut it into several files.",
        )
    numbers = (found.rest, found.angles_rad, found.root, *found.places.values())
    if not all(np.isfinite(one).all() for one in numbers):
        raise unusable(found.path, "whose numbers are not all finite", "Export it again.")
    if not RATES_HZ[0] <= found.fps <= RATES_HZ[1]:
        raise unusable(
            found.path,
            f"at {found.fps:.3g} frames a second",
            "'Frame Time' is the seconds from one frame to the next.",
        )
