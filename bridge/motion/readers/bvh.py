"""BVH as programs write it, checked, and brought to SMPL's joints (`bridge.motion.retargeting`).

A name is all that stands behind ROOT or JOINT, blanks too. Channels may come in any order and
number; the count of frames is that of the lines. Of several people the first is read.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.motion.cuts import frames_of_rest_pose
from bridge.motion.motion import AS_IT_SAYS, MOST_FRAMES, RATES_HZ, HowRead, Motion
from bridge.motion.retargeting import retargeted
from bridge.motion.skeletons import SkeletonMotion, unusable
from bridge.runs.untrusted import file_refused, open_regular

_MOST_BYTES = 64 << 20
"""A minute of fifty joints at 120 Hz takes a fifth of it."""
_LIKE_RADIANS = 2 * np.pi
"""No number that is written for an angle in radians is larger; of degrees somebody's always is."""
_MOST_JOINTS = 512
_ROUNDED, _FASTEST = 5e-5, 1e6
_HEAD = re.compile(r"(frames|frame\s*time)\s*:\s*(\S+)\s*", re.IGNORECASE)


def read(path: Path, how: HowRead = AS_IT_SAYS) -> Motion:
    """Read one file; a rest pose before the motion is left out (`bridge.motion.cuts`)."""
    with file_refused(path, unusable, ""):
        with open_regular(path, _MOST_BYTES) as file:
            lines = file.read().decode("utf-8-sig", errors="replace").splitlines()
        skeleton = _skeleton(path, lines)
    motion = retargeted(skeleton, how)
    first = frames_of_rest_pose(motion.pose, motion.fps) if motion.fps > 0 else 0
    return replace(motion.frames(slice(first, None)), rest_pose_frames=first)


@dataclass
class _Joint:
    """As the hierarchy has it."""

    name: str
    parent: int
    offset: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    columns: dict[str, int] = field(default_factory=dict)
    """Of each of its channels, such as `Xposition`, in the file's order."""
    tip: list[float] | None = None


def _skeleton(path: Path, lines: list[str]) -> SkeletonMotion:
    """ValueError if a line is none of a BVH, DsnetError if the motion is none of a person."""
    begin = next((n for n, line in enumerate(lines) if line.strip().upper() == "MOTION"), -1)
    if begin < 0:
        raise ValueError("no line MOTION")
    joints, width = _hierarchy(lines[:begin])
    declared, frame_s, rows = _rows(lines[begin + 1 :], width)
    notes = []
    if declared != len(rows):
        notes.append(f"{path} declares {declared:g} frames and holds {len(rows)}: all are read")
    if len(roots := [n for n, joint in enumerate(joints) if joint.parent < 0]) > 1:
        others = ", ".join(joints[n].name for n in roots[1:])[:100]
        notes.append(f"{path} holds {len(roots)} people: the first is read, not that of {others}")
        joints = joints[: roots[1]]
    skeleton = _moving(path, joints, np.array(rows))
    most_deg = np.degrees(np.abs(skeleton.angles_rad[:, 1:]).max(initial=0))
    if len(rows) > 1 and most_deg < _LIKE_RADIANS:
        notes.append(
            f"{path} turns no joint by more than {most_deg:.2g} degrees: if these are radians, "
            "convert them"
        )
    skeleton = replace(skeleton, fps=_rate(frame_s), notes=tuple(notes))
    if not RATES_HZ[0] <= skeleton.fps <= RATES_HZ[1] and not np.isnan(skeleton.fps):
        remedy = "'Frame Time' is the seconds from one frame to the next."
        raise unusable(path, f"at {skeleton.fps:.3g} frames a second", remedy)
    return skeleton


def _rate(frame_s: float) -> float:
    """Frames a second of seconds with few digits: 120 of 0.0083333."""
    fps = 1 / frame_s
    near = round(fps) if 0.5 < fps < _FASTEST else fps
    return float(near) if abs(fps - near) < _ROUNDED * near else fps


def _hierarchy(lines: Iterable[str]) -> tuple[list[_Joint], int]:
    """The joints, parents first, and how many numbers a frame has."""
    joints: list[_Joint] = []
    opened: list[int] = []  # joints whose brace is open; -1 of a tip
    is_tip, width = False, 0
    for row in (row for line in lines for row in re.split(r"([{}])", line)):
        words = row.split()
        match words[0].upper() if words else "":
            case "ROOT" | "JOINT" as kind:
                name = row.strip()[len(kind) :].strip()
                joints.append(_Joint(name, -1 if kind == "ROOT" else opened[-1]))
            case "END":
                is_tip = True
            case "{":
                opened.append(-1 if is_tip else len(joints) - 1)
            case "}":
                is_tip = False if opened.pop() == -1 else is_tip
            case "OFFSET":
                place = [float(word) for word in words[1:4]]
                if len(place) != 3:
                    raise ValueError(f"joint {joints[-1].name} with an OFFSET of {len(place)}")
                if is_tip:
                    joints[-1].tip = place
                else:
                    joints[-1].offset = place
            case "CHANNELS":
                names = words[2:]
                channels = {
                    word[0].upper() + word[1:].lower(): width + n for n, word in enumerate(names)
                }
                if len(channels) < len(names):
                    raise ValueError(f"joint {joints[-1].name} with a channel twice")
                joints[-1].columns = channels
                width += len(names)
        if len(joints) > _MOST_JOINTS:
            raise ValueError(f"more than {_MOST_JOINTS} joints")
    if not joints or joints[0].parent >= 0:
        raise ValueError("no ROOT")
    return joints, width


def _rows(lines: Iterable[str], width: int) -> tuple[float, float, list[NDArray[np.float64]]]:
    """How many frames are declared, seconds of one (nan: not stated), and their numbers."""
    stated = {"frames": np.nan, "frametime": np.nan}
    rows: list[NDArray[np.float64]] = []
    for line in lines:
        if head := _HEAD.fullmatch(line.strip()):
            stated["".join(head[1].lower().split())] = float(head[2])
        elif words := line.split():
            if len(words) != width:
                if any(word.lower() in ("nan", "inf", "-inf") for word in words):
                    raise ValueError("numbers that are not all finite")
                raise ValueError(f"{len(words)} numbers in a line of {width} channels")
            if len(rows) == MOST_FRAMES:
                raise ValueError(f"more than {MOST_FRAMES} frames: cut it into several files")
            rows.append(np.array(words, np.float64))
    if not rows:
        raise ValueError("no frames")
    return stated["frames"], stated["frametime"] or np.nan, rows


def _moving(path: Path, joints: list[_Joint], rows: NDArray[np.float64]) -> SkeletonMotion:
    """The joints with their numbers, at no rate yet."""
    angles, axes = np.zeros((len(rows), len(joints), 3)), []
    places: dict[int, NDArray[np.float64]] = {}
    for number, joint in enumerate(joints):
        turns = [name for name in joint.columns if name.endswith("rotation")]
        order = "".join(name[0] for name in turns)
        axes.append(order + "".join(axis for axis in "XYZ" if axis not in order)[: 3 - len(order)])
        if not re.fullmatch("[XYZ]{3}", axes[-1]):
            raise ValueError(f"joint {joint.name} with rotations {order}")
        angles[:, number, : len(turns)] = np.radians(rows[:, [joint.columns[t] for t in turns]])
        moved = [(n, f"{axis}position") for n, axis in enumerate("XYZ")]
        if given := [(n, joint.columns[name]) for n, name in moved if name in joint.columns]:
            places[number] = np.tile(np.array(joint.offset), (len(rows), 1))
            places[number][:, [n for n, _ in given]] = rows[:, [column for _, column in given]]
            if not any(joint.offset):  # some write places alone
                joint.offset = (
                    np.median(places[number], axis=0).tolist() if number else joint.offset
                )
    if not np.isfinite(rows).all() or not np.isfinite([joint.offset for joint in joints]).all():
        raise unusable(path, "whose numbers are not all finite", "Export it again.")
    rest = np.array([joint.offset for joint in joints])
    for number, joint in enumerate(joints[1:], 1):
        rest[number] += rest[joint.parent]
    root = places.pop(0, np.tile(rest[0], (len(rows), 1)))
    return SkeletonMotion(
        path=path,
        names=tuple(joint.name for joint in joints),
        parents=tuple(joint.parent for joint in joints),
        rest=rest,
        tips={n: rest[n] + joint.tip for n, joint in enumerate(joints) if joint.tip},
        axes=tuple(axes),
        angles_rad=angles,
        root=root,
        places=places,
        fps=np.nan,
    )
