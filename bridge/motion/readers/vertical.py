"""Which way is up in the world of a motion's poses: what its file says of it, or its bodies show.

Bodies stand along z as in AMASS, or along y as video models and generators write. The world of
SLAHMR and its kin has the axes of a video's first camera: y down, and pitched as that looked up or
down. It is turned by the normal of its floor, or by its bodies.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.motion.directions import angle_deg, shortest_turn, unit
from bridge.motion.motion import HowRead, UpAxis
from bridge.motion.readers.joint_rotations import unusable
from bridge.motion.readers.smpl_fields import (
    FLOOR_KEY,
    OF_FIRST_CAMERA,
    POSE_KEYS,
    Arrays,
    first_of,
)
from bridge.motion.retargeting import (
    smpl_places,
    some_frames,
    standing_direction,
    world_rotations,
)
from bridge.motion.skeletons import OWN_NAMES

_STANDING, _ASLANT = 0.7, 0.5
"""Least share of an axis in the mean direction of trunk and legs that stand along it, and the
largest of the other one beside it."""
_LYING = 0.3
"""Largest share of z in the direction of a trunk that is upright along y, as of who sits."""
_LEANING = 0.85, 0.4, 0.9
"""Least length of the mean direction of bodies that lean one way all the time, and least and
largest share of z in it: less, and they lie in a world with z up; more, and they stand."""
_Y = np.array([0.0, 1.0, 0.0])
_FLIP = np.diag([1.0, -1.0, -1.0])
_EXPORT = "Export the motion in the world's space"


def vertical_of(
    path: Path, arrays: Arrays, pose: NDArray[np.float64], how: HowRead, notes: list[str]
) -> tuple[UpAxis, NDArray[np.float64] | None]:
    """The vertical axis, and (3, 3) what turns the file's world so that it is that one, if it was
    none: the axis along which the bodies stand, or their trunks y; if they stand along none, z as
    in AMASS, but of smplcodec's files y."""
    if how.up != "auto":
        return how.up, None
    world = world_rotations(pose[some_frames(len(pose))])
    places = smpl_places(world).swapaxes(0, 1)
    direction = standing_direction(dict(zip(OWN_NAMES, places, strict=True)))
    if FLOOR_KEY in arrays or first_of(arrays, OF_FIRST_CAMERA):
        return "y", _turned_upright(path, arrays, direction, notes)
    _, y, z = direction
    _, trunk_y, trunk_z = np.median(world[:, 0, :, 1], axis=0)
    stands = abs(y) >= _STANDING and abs(z) <= _ASLANT * abs(y)
    sits = trunk_y > _STANDING and abs(trunk_z) < _LYING
    if stands or sits:
        if stands and y < 0:
            remedy = f"{_EXPORT}, or, if they lie there and z is up, say --up z."
            flaw = "whose bodies stand head down along y, as in the space of a camera"
            raise unusable(path, flaw, remedy)
        notes.append(f"{path} is taken as y up, for its bodies stand so: --up says otherwise")
        return "y", None
    least, *shares = _LEANING
    leans = np.linalg.norm(direction) >= least and shares[0] <= abs(z) <= shares[1]
    if leans and min(y, z) < -shares[0]:
        flaw = "whose bodies lean head down, as in the space of a camera that looks up or down"
        raise unusable(path, flaw, f"{_EXPORT}, or say its vertical by --up.")
    if first_of(arrays, POSE_KEYS) == "bodyPose":
        if z < _STANDING or abs(y) > _ASLANT * z:
            return "y", None
        notes.append(f"{path} is taken as z up, for its bodies stand so: --up says otherwise")
        return "z", None
    axis: UpAxis = "y" if leans and y > z else "z"
    if leans:
        lean_deg = angle_deg(direction, _Y if axis == "y" else np.array([0.0, 0.0, 1.0]))
        notes.append(
            f"{path} leans by {lean_deg:.0f} degrees all the time, taken as {axis} up: its world "
            "may be that of a camera that looks up or down, which a turn of its root and places "
            "would put upright"
        )
    return axis, None


def _turned_upright(
    path: Path, arrays: Arrays, direction: NDArray[np.float64], notes: list[str]
) -> NDArray[np.float64]:
    """(3, 3) from a first camera's world to y up."""
    floor = arrays.get(FLOOR_KEY, np.zeros(3))
    is_one = floor.size and floor.shape[-1] in (3, 4) and floor.dtype.kind == "f"
    normal = unit(floor.reshape(-1, floor.shape[-1])[0, :3]) if is_one else np.zeros(3)
    says = f"its {FLOOR_KEY!r} says"
    if np.isfinite(normal).all() and normal.any():
        upwards = normal @ direction
        # Of who lies it says nothing; y is mostly down.
        if upwards < -_LYING or (upwards < _LYING and normal[1] > 0):
            normal = -normal
    elif np.linalg.norm(direction) >= _STANDING:
        normal, says = unit(direction), "its bodies stand, to some degrees"
    else:
        flaw = "whose world is a camera's, and whose bodies do not show where up is"
        remedy = f"Keep its {FLOOR_KEY!r} beside the poses, or say its vertical by --up."
        raise unusable(path, flaw, remedy)
    axis, is_down = ("y down", True) if normal[1] < 0 else ("y up", False)
    pitch_deg = float(angle_deg(normal, -_Y if is_down else _Y))
    notes.append(
        f"{path} is of a camera's world, {axis} and pitched by {pitch_deg:.0f} degrees: it is "
        f"turned upright as {says}; --up leaves it as it is"
    )
    # A shortest turn is none from y down to y up.
    return shortest_turn(_FLIP @ normal, _Y) @ _FLIP if is_down else shortest_turn(normal, _Y)
