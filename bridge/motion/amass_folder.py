"""Which files below a folder of AMASS are motions that a run can be tested on."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.motion.amass_file import gender_of_motion
from bridge.runs.processes import notify


def find_amass_motions(folder: Path, gender: str, known: Iterable[str] = ()) -> list[Path]:
    """The motions below `folder` that a body model of `gender` can follow, in order of path.

    Left out, with one line on stderr that counts them: files without `poses` (`shape.npz`,
    `*_stagei.npz`, body models); people of the other gender, whose shape coefficients mean
    something else; and motions whose name is already there: those of `known` (`DFaust` holds the
    very motions that Dyna's meshes show) and second copies (SMPL-H beside SMPL-X).

    Raises
    ------
    DsnetError
        If the folder is none, holds no such motion, or holds an `.npz` that cannot be read.
    """
    other = {"female": "male", "male": "female"}.get(gender)
    taken, motions, left_out = set(known), [], Counter[str]()
    for path in sorted(folder.rglob("*.npz")):
        name, stated = "_".join(subject_and_motion(path)), gender_of_motion(path)
        if stated is None:
            left_out["without poses"] += 1
        elif stated == other:
            left_out[f"of {other} bodies"] += 1
        elif name in taken:
            left_out["of motions already there"] += 1
        else:
            taken.add(name)
            motions.append(path)
    counts = ", ".join(f"{count} {why}" for why, count in left_out.items())
    if not motions:
        raise DsnetError(
            f"--amass {folder}, with {counts or 'no .npz'} and no motion",
            f"a folder of AMASS motions of {gender} bodies",
            "Check the path, or leave --amass out.",
        )
    if left_out:
        notify(f"{folder}: {len(motions)} motions; left out: {counts}")
    return motions


def subject_of_shape(name: str, betas: NDArray, shapes: Mapping[str, NDArray]) -> str:
    """Who among `shapes` (10,) is called `name` and has the shape `betas` (10,), or a new name.

    In a folder without subfolders everybody has the folder's name; what a file says of its person
    is the shape. The second person is called `name-2`, and so on.
    """
    names = (name if number == 1 else f"{name}-{number}" for number in count(1))
    return next(one for one in names if one not in shapes or np.array_equal(shapes[one], betas))


def subject_and_motion(path: Path) -> tuple[str, str]:
    """Who does what: `50004_kicking_poses.npz`, or AMASS's own `50004/kicking_poses.npz`."""
    stem = path.stem.removesuffix("_poses").removesuffix("_stageii")
    subject, _, motion = stem.partition("_")
    return (subject, motion) if subject.isdecimal() and motion else (path.parent.name, stem)
