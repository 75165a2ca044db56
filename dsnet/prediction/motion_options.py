"""Which body moves, and how its motion file is read: options of every command that moves one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from bridge.motion.motion import Up
from bridge.options import PositiveFloat


@dataclass(frozen=True, kw_only=True)
class MotionOptions:
    """A body and a motion file; what is left at its default is as the file says."""

    body: Path | None = None
    """Another body than the predictor was trained on, or DSNET_BODY for always: an SMPL, SMPL-H or
    SMPL-X model file, a folder of them, or `embedded:male`; for `dsnet_plus`."""
    gender: Literal["female", "male", "neutral"] | None = None
    """Of the body, where the motion file says none or another."""
    pose: Literal["file", "bony"] = "file"
    """`bony`: the chest follows the file's markers on bone; a pose that was fitted to all of them,
    as AMASS's, holds part of the bounce, which predicted flesh would then count twice."""
    motion_fps: PositiveFloat | None = None
    """Frames per second of the motion file, where it says none or a wrong one."""
    up: Up = "auto"
    """Vertical axis of the motion file; `auto`: the one along which its bodies stand."""
    joint_map: Path | None = None
    """Text file that says which joint of a BVH is which, `left_hip = Bip01 L Thigh` a line."""
    smooth_hz: PositiveFloat | Literal["auto"] | None = None
    """Leave out what is faster in the motion: the noise of a recording shakes the skin. `auto`
    finds the cutoff that suits each moment."""
