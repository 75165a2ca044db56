"""BVH as programs write it, checked, and brought to SMPL's joints (`bridge.motion.retargeting`).

A name is all that stands behind ROOT or JOINT, blanks too. Channels may come in any order and
number; the count of frames is that of the lines, unless they are wrapped. Of several people the
first is read.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.motion.motion import AS_IT_SAYS, MOST_FRAMES, RATES_HZ, HowRead, Motion
from bridge.motion.retargeting import retargeted
from bridge.motion.skeletons import SkeletonMotion, joints_by_name, unusable
from bridge.runs.untrusted import file_refused, open_regular

_MOST_BYTES = 64 << 20
"""A minute of fifty joints at 120 Hz takes a fifth of it."""
_LIKE_RADIANS = 2 * np.pi
"""No number that is written for an angle in radians is larger; of degrees somebody's always is."""
_MOST_JOINTS = 512
_ROUNDED, _FASTEST = 5e-5, 1e6
_HEAD = re.compile(r"(frames|frame\s*time)\s*:\s*(\S.*)", re.IGNORECASE)


def read(path: Path, how: HowRead = AS_IT_SAYS) -> Motion:
    """Read one file."""
    with file_refused(path, unusable, ""):
        with open_regular(path, _MOST_BYTES) as file:
            lines = file.read().decode("utf-8-sig", errors="replace").splitlines()
        skeleton = _person(path, _skeletons(path, lines, how), how)
    return retargeted(skeleton, how)


@dataclass
class _Joint:
    """As the hierarchy has it."""

    name: str
    parent: int
    offset: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    columns: dict[str, int] = field(default_factory=dict)
    """Of each of its channels, such as `Xposition`, in the file's order."""
    tip: list[float] | None = None


def _person(path: Path, skeletons: list[SkeletonMotion], how: HowRead) -> SkeletonMotion:
    """The first that is a person's; of none the largest, whose refusal says what it lacks."""

    def is_person(one: SkeletonMotion) -> bool:
        try:
            return bool(joints_by_name(one, how.joint_map))
        except DsnetError:
            return False

    people = [one for one in skeletons if is_person(one)]
    person = people[0] if people else max(skeletons, key=lambda one: len(one.names))
    notes = [*person.notes]
    if others := ", ".join(one.names[0] for one in people[1:])[:100]:
        notes.append(f"{path} holds {len(people)} people: the first is read, not that of {others}")
    if props := ", ".join(one.names[0] for one in skeletons if one not in people)[:100]:
        notes.append(f"{path} also holds {props}, which is no person and left out")
    most_deg = np.degrees(np.abs(person.angles_rad[:, 1:]).max(initial=0))
    if len(person.root) > 1 and most_deg < _LIKE_RADIANS:
        notes.append(
            f"{path} turns no joint by more than {most_deg:.2g} degrees: if these are radians, "
            "convert them"
        )
    return replace(person, notes=tuple(notes))


def _skeletons(path: Path, lines: list[str], how: HowRead) -> list[SkeletonMotion]:
    """Of each root what moves below it.

    ValueError if a line is none of a BVH, DsnetError if it has another rate than any motion's.
    """
    begin = next((n for n, line in enumerate(lines) if line.strip().upper() == "MOTION"), -1)
    if begin < 0:
        raise ValueError("no line MOTION")
    joints, width = _hierarchy(lines[:begin])
    declared, frame_time, rows = _rows(lines[begin + 1 :], width)
    notes, fps = [], _rate(frame_time)
    if declared != len(rows):
        notes.append(f"{path} declares {declared:g} frames and holds {len(rows)}: all are read")
    if frame_time and not RATES_HZ[0] <= fps <= RATES_HZ[1]:
        flaw = f"with a 'Frame Time' of {frame_time[:40]}"
        if how.fps is None:
            seconds = "It is the seconds from one frame to the next."
            raise unusable(path, flaw, f"{seconds} --motion-fps says how many frames a second.")
        notes.append(f"{path} is read at {how.fps:g} frames a second, not {flaw}")
        fps = how.fps
    roots = [n for n, joint in enumerate(joints) if joint.parent < 0]
    parts = [
        [replace(joint, parent=max(joint.parent - first, -1)) for joint in joints[first:last]]
        for first, last in pairwise([*roots, len(joints)])
    ]
    return [replace(_moving(path, part, rows), fps=fps, notes=tuple(notes)) for part in parts]


def _rate(frame_time: str) -> float:
    """Frames a second of seconds with few digits: 120 of 0.0083333; nan of what is no number."""
    try:
        fps = 1 / float(frame_time.replace(",", "."))
    except (ValueError, ZeroDivisionError):
        return np.nan
    near = round(fps) if 0.5 < fps < _FASTEST else fps
    return float(near) if abs(fps - near) < _ROUNDED * near else fps


def _words(line: str) -> list[str]:
    """Some programs write decimal commas, others commas between numbers."""
    return line.replace(",", " " if "." in line else ".").split()


def _hierarchy(lines: Iterable[str]) -> tuple[list[_Joint], int]:
    """The joints, parents first, and how many numbers a frame has."""
    joints: list[_Joint] = []
    opened: list[int] = []  # joints whose brace is open; -1 of a tip
    is_tip, width = False, 0
    for row in (row for line in lines for row in re.split(r"([{}])", line)):
        words = _words(row)
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


def _rows(lines: Iterable[str], width: int) -> tuple[float, str, NDArray[np.float64]]:
    """How many frames are declared (nan: not stated), the time of one, and numbers (T, width).

    A frame may be wrapped onto several lines, if the numbers are those of the frames declared.
    """
    stated = {"frames": "nan", "frametime": ""}
    rows: list[NDArray[np.float64]] = []
    for line in lines:
        if head := _HEAD.fullmatch(line.strip()):
            stated["".join(head[1].lower().split())] = head[2]
        elif words := _words(line):
            rows.append(np.array(words, np.float64))
    if not rows:
        raise ValueError("no frames")
    numbers = np.concatenate(rows)
    if len(numbers) > MOST_FRAMES * max(width, 1):
        raise ValueError(f"more than {MOST_FRAMES} frames: cut it into several files")
    other = next((len(row) for row in rows if len(row) != width), None)
    declared = float(stated["frames"])
    if other is not None and len(numbers) != declared * width:
        if not np.isfinite(numbers).all():
            raise ValueError("numbers that are not all finite")
        raise ValueError(f"{other} numbers in a line of {width} channels")
    return declared, stated["frametime"], numbers.reshape(-1, width)


def _moving(path: Path, joints: list[_Joint], rows: NDArray[np.float64]) -> SkeletonMotion:
    """The joints below one root with their numbers, at no rate yet."""
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
