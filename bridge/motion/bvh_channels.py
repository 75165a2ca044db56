"""BVH files in which joints below the root have positions too, as Blender writes them by default.

pybvh reads rotations alone there. So the positions are taken out of the text, which is then the
same motion without them, and given back beside it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass
class _Joint:
    """Where a joint's positions stand in a line of the motion."""

    name: str
    axes: str
    """Of the positions, in their order."""
    columns: list[int]


@dataclass(frozen=True, eq=False)
class PlainBvh:
    """A file with positions on the root alone, and those of other joints."""

    lines: list[str]
    """Of the file."""
    places: dict[str, NDArray[np.float64]]
    """(T, 3) by joint: its place in its parent's frame, which counts in place of its OFFSET."""

    @classmethod
    def of(cls, lines: Iterable[str]) -> PlainBvh:
        """Of a file's lines.

        Raises
        ------
        ValueError
            If a joint has some of the three positions, or one of a line's numbers is missing.
        """
        rows = iter(lines)
        header, joints, width = _hierarchy(rows)
        if not joints:
            return cls([*header, *rows], {})
        taken = np.array([column for joint in joints for column in joint.columns])
        kept = np.setdiff1d(np.arange(width), taken).tolist()
        plain, numbers = header, []
        for row in rows:
            words = row.split()
            if not words or words[0].startswith("Frame"):
                plain.append(row)
                continue
            if len(words) != width:
                raise ValueError(f"{len(words)} numbers in a line of {width} channels")
            plain.append(" ".join(words[column] for column in kept) + "\n")
            numbers.append([float(words[column]) for column in taken])
        places = np.array(numbers, np.float64).reshape(len(numbers), len(joints), 3)
        orders = [[joint.axes.index(axis) for axis in "XYZ"] for joint in joints]
        return cls(plain, {j.name: places[:, n, orders[n]] for n, j in enumerate(joints)})


def _hierarchy(rows: Iterator[str]) -> tuple[list[str], list[_Joint], int]:
    """Lines up to MOTION without positions below the root; who had them; channels in all."""
    header: list[str] = []
    joints: list[_Joint] = []
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
                joints.append(_Joint(name, axes, [width + n for n in places]))
                turns = [word for n, word in enumerate(channels) if n not in places]
                row = f"{row[: row.index('CHANNELS')]}CHANNELS {len(turns)} {' '.join(turns)}\n"
            width += len(channels)
        header.append(row)
        if head == "MOTION":
            break
    return header, joints, width
