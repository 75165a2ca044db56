"""A motion as its file holds it, whatever the format."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from bridge.motion.amass_file import StoredMotion, gender_of_motion, read_amass_file
from bridge.motion.lead_in import lead_in_frames

SUFFIXES = (".npz", ".bvh")


def read_motion_file(path: Path) -> StoredMotion:
    """Read an AMASS `.npz`, or a BVH, whose skeleton is brought to SMPL's joints.

    A rest pose before the motion of a BVH is left out (`bridge.motion.lead_in`).

    Raises
    ------
    DsnetError
        If the file is missing, is neither, or holds no usable motion.
    """
    return _read_bvh(path) if is_bvh(path) else read_amass_file(path)


def gender_of_file(path: Path) -> str | None:
    """Whose motion it is, as `gender_of_motion` says it; a BVH does not tell: `unknown`.

    Raises
    ------
    DsnetError
        If an `.npz` cannot be read.
    """
    return "unknown" if is_bvh(path) else gender_of_motion(path)


def is_bvh(path: Path) -> bool:
    """By its name."""
    return path.suffix.lower() == ".bvh"


def _read_bvh(path: Path) -> StoredMotion:
    # What reads and brings it to SMPL takes half a second to import.
    from bridge.motion.bvh_file import read_bvh_file
    from bridge.motion.retargeting import retargeted

    stored = retargeted(read_bvh_file(path))
    first = lead_in_frames(stored.pose, stored.fps)
    return replace(stored, pose=stored.pose[first:], trans_m=stored.trans_m[first:], lead_in=first)
