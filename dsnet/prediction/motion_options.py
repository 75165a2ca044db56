"""Which body moves, and how its motion file is read: options of every command that moves one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from bridge.motion.motion import Up
from bridge.options import PositiveFloat, PositiveInt


@dataclass(frozen=True, kw_only=True)
class MotionOptions:
    """A body and a motion file; what is left at its default is as the file says."""

    body: Path | None = None
    """Body model in place of the predictor's own, which only `dsnet_plus` can move: an SMPL, SMPL-H
    or SMPL-X file, a folder of them, or `embedded`. DSNET_BODY sets it for every command."""
    gender: Literal["female", "male", "neutral"] | None = None
    """Gender of the body, where the motion file has none or a wrong one."""
    pose: Literal["file", "bony"] = "file"
    """`file`: the pose of the file; `bony`: the chest follows the file's markers on bone alone. A
    pose that was fitted to all markers, as AMASS's, already contains part of the soft tissue's
    motion, which the prediction would add again."""
    motion_fps: PositiveFloat | None = None
    """Frame rate of the motion file in frames per second, where it has none or a wrong one."""
    up: Up = "auto"
    """Vertical axis of the motion file; `auto`: the axis along which its bodies stand."""
    joint_map: Path | None = None
    """Text file that maps the joints of a BVH, one a line: `left_hip = Bip01 L Thigh`."""
    smooth_hz: PositiveFloat | Literal["auto"] | None = None
    """Cutoff in Hz of a low-pass filter on the motion, as noise of a recording shakes the skin.
    `auto` finds the cutoff that suits each moment."""
    person: PositiveInt | None = None
    """Whose motion of several people's in the motion file: 1 is the first; by default who is seen
    longest."""
