"""Pops in a motion: moments at which a joint or the root moves as nobody can.

Where a recording loses a marker, or its solver turns a limb the other way round and back, a leg
flips within some frames. The eye sees a flicker of one frame; tissue is hit by it and swings
for half a second. A pop is no cut (`bridge.motion.cuts`): the motion is the same before and after.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.motion.cuts import turns_rad
from bridge.motion.resampling import Motion
from bridge.motion.theta import unpack_theta
from bridge.paper import N_JOINTS

MOST_TURN_DEG_S = 3500.0
"""Of trunk and legs: between the fastest ankles in recorded dances and the faults beside them."""
MOST_ARM_TURN_DEG_S = 8000.0
"""Of the arms, the neck and the head: more than a pitcher's shoulder reaches."""
MOST_ROOT_G = 20.0
"""Of the root's acceleration from frame to frame: more than recorded landings have."""
_ARMS = ("neck", "head", "collar", "shoulder", "elbow", "wrist")
_GRAVITY_M_S2 = 9.81
_APART_S = 0.25
_TOLD = 5
_MOST_TURNS_DEG_S = np.array(
    [
        MOST_ARM_TURN_DEG_S if name.endswith(_ARMS) else MOST_TURN_DEG_S
        for name in SMPL_JOINT_NAMES[:N_JOINTS]
    ]
)


def find_pops(motion: Motion, pieces: Sequence[slice]) -> dict[int, str]:
    """The first frame of each pop, and what moves there: a joint's name, or `root`.

    Frames less than a quarter of a second apart are one pop.

    Parameters
    ----------
    pieces : those between cuts.
    """
    found: dict[int, str] = {}
    for piece in pieces:
        excess = _excess(motion.theta[piece], motion.fps)
        last = -np.inf
        for frame in np.flatnonzero((excess > 1).any(axis=1)):
            if frame - last > _APART_S * motion.fps:
                name = [*SMPL_JOINT_NAMES[:N_JOINTS], "root"][int(excess[frame].argmax())]
                found[piece.start + int(frame)] = name
            last = frame
    return found


def pop_warning(motion: Motion, pieces: Sequence[slice]) -> str:
    """One line that names them; empty if there is none."""
    pops = find_pops(motion, pieces)
    if not pops:
        return ""
    named = ", ".join(
        f"{name} at {frame / motion.fps:.2f} s" for frame, name in list(pops.items())[:_TOLD]
    )
    more = f" and {len(pops) - _TOLD} more" if len(pops) > _TOLD else ""
    return (
        f"{motion.source} moves faster than anybody can: {named}{more}: "
        "if it is a fault of the recording, smooth it there, for it throws the tissue"
    )


def _excess(theta: NDArray[np.floating], fps: float) -> NDArray[np.float64]:
    """(T, 23) how far each joint's speed and the root's acceleration are above the bound, as 1."""
    found = np.zeros((len(theta), N_JOINTS + 1))
    pose, trans_m = unpack_theta(np.asarray(theta, np.float64))
    if len(theta) > 1:
        turn_deg = np.degrees(turns_rad(pose[:-1], pose[1:]))
        found[1:, :N_JOINTS] = turn_deg * fps / _MOST_TURNS_DEG_S
    if len(theta) > 2:
        bent_m = np.linalg.norm(np.diff(trans_m, 2, axis=0), axis=1)
        found[1:-1, N_JOINTS] = bent_m * fps**2 / (MOST_ROOT_G * _GRAVITY_M_S2)
    return found
