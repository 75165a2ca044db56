"""BVH, read by pybvh and checked, and brought to SMPL's joints (`bridge.motion.retargeting`)."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.motion.cuts import frames_of_rest_pose
from bridge.motion.motion import MOST_FRAMES, RATES_HZ, Motion
from bridge.motion.retargeting import SkeletonMotion, retargeted, unusable
from bridge.runs.untrusted import damage_refused, open_regular

SUFFIXES = (".bvh",)
_MOST_BYTES = 64 << 20
"""A minute of fifty joints at 120 Hz takes a fifth of it."""
_MOST_JOINTS = 512


def sniff(path: Path) -> bool:
    """By its name."""
    return path.suffix.lower() in SUFFIXES


def gender_of(path: Path) -> str | None:
    """A BVH does not tell, and is not read to be found."""
    return "unknown"


def read(path: Path) -> Motion:
    """Read one file; a rest pose before the motion is left out (`bridge.motion.cuts`)."""
    motion = retargeted(_skeleton(path))
    first = frames_of_rest_pose(motion.pose, motion.fps)
    return replace(motion, theta=motion.theta[first:], rest_pose_frames=first)


def _skeleton(path: Path) -> SkeletonMotion:
    if path.suffix != ".bvh":  # pybvh reads no `.BVH`, as which Windows writes many a file
        raise unusable(path, "whose name does not end in small letters", "Rename it to .bvh.")
    import pybvh  # it draws too, and so takes half a second to import
    from pybvh.bvhnode import BvhJoint

    with damage_refused(partial(_unreadable, path), RecursionError):
        with open_regular(path, _MOST_BYTES) as file:
            lines = file.read().decode(errors="replace").splitlines(keepends=True)
        lines, places = positions_apart(lines)
        if places:  # pybvh reads files alone
            with tempfile.TemporaryDirectory() as folder:
                copy = Path(folder) / path.name
                copy.write_text("".join(lines), encoding="utf-8")
                bvh = pybvh.read_bvh_file(copy, world_up="+y")
        else:
            bvh = pybvh.read_bvh_file(path, world_up="+y")
        joints = [node for node in bvh.nodes if isinstance(node, BvhJoint)]
        number = {id(node): row for row, node in enumerate(joints)}
        rest = np.array([node.offset for node in joints], np.float64)
        parents = tuple(-1 if n.parent is None else number[id(n.parent)] for n in joints)
        for row, parent in enumerate(parents):
            if parent >= 0:
                rest[row] += rest[parent]
        found = SkeletonMotion(
            path=path,
            names=tuple(node.name for node in joints),
            parents=parents,
            rest=rest,
            axes=tuple("".join(node.rot_channels) for node in joints),
            angles_rad=np.asarray(bvh.joint_angles, np.float64),
            root=np.asarray(bvh.root_pos, np.float64),
            places={
                row: places[node.name] for row, node in enumerate(joints) if node.name in places
            },
            fps=1.0 / bvh.frame_time,
        )
    _check(found)
    return found


def _unreadable(path: Path, error: Exception) -> DsnetError:
    if isinstance(error, FileNotFoundError):
        return unusable(path, "which does not exist", "Check the path.")
    if isinstance(error, IsADirectoryError):
        return unusable(path, "which is a folder", "Name one file in it.")
    return unusable(path, f"which does not load ({str(error)[:200]})")


def _check(found: SkeletonMotion) -> None:
    frames, joints = found.angles_rad.shape[:2]
    if frames > MOST_FRAMES or joints > _MOST_JOINTS:
        flaw = f"{frames} frames of {joints} joints"
        remedy = f"At most {MOST_FRAMES} of {_MOST_JOINTS}: cut it into several files."
        raise unusable(found.path, flaw, remedy)
    numbers = (found.rest, found.angles_rad, found.root, *found.places.values())
    if not all(np.isfinite(one).all() for one in numbers):
        raise unusable(found.path, "whose numbers are not all finite", "Export it again.")
    if not RATES_HZ[0] <= found.fps <= RATES_HZ[1]:
        remedy = "'Frame Time' is the seconds from one frame to the next."
        raise unusable(found.path, f"at {found.fps:.3g} frames a second", remedy)


def positions_apart(lines: Iterable[str]) -> tuple[list[str], dict[str, NDArray[np.float64]]]:
    """A file's lines without positions below the root, and these (T, 3) by joint.

    Blender writes them by default: the place in the parent's frame, which counts in place of the
    OFFSET. pybvh reads rotations alone there. ValueError if a joint has some of the three
    positions, or one of a line's numbers is missing.
    """
    rows, plain = iter(lines), []
    joints: list[tuple[str, list[int]]] = []  # with the columns of X, Y, Z
    name, is_root, width = "", True, 0
    for row in rows:
        words = row.split()
        head = words[0] if words else ""
        if head in ("ROOT", "JOINT"):
            name, is_root = " ".join(words[1:]), head == "ROOT"
        elif head == "CHANNELS":
            channels = words[2:]
            places = [n for n, word in enumerate(channels) if word.lower().endswith("position")]
            if places and not is_root:
                axes = "".join(channels[n][0].upper() for n in places)
                if sorted(axes) != list("XYZ"):
                    raise ValueError(f"joint {name} with positions along {axes} alone")
                joints.append((name, [width + places[axes.index(axis)] for axis in "XYZ"]))
                turns = [word for n, word in enumerate(channels) if n not in places]
                row = f"{row[: row.index('CHANNELS')]}CHANNELS {len(turns)} {' '.join(turns)}\n"
            width += len(channels)
        plain.append(row)
        if head == "MOTION":
            break
    if not joints:
        return [*plain, *rows], {}
    taken = [column for _, columns in joints for column in columns]
    kept, numbers = np.setdiff1d(np.arange(width), taken).tolist(), []
    for row in rows:
        words = row.split()
        if not words or words[0].startswith("Frame"):
            plain.append(row)
            continue
        if len(words) != width:
            raise ValueError(f"{len(words)} numbers in a line of {width} channels")
        plain.append(" ".join(words[column] for column in kept) + "\n")
        numbers.append([float(words[column]) for column in taken])
    found = np.array(numbers, np.float64).reshape(len(numbers), len(joints), 3)
    return plain, {name: found[:, row] for row, (name, _) in enumerate(joints)}
