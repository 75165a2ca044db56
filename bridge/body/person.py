"""What a body model of a person is: its size, its axes, its sides, and its weights."""

from __future__ import annotations

import numpy as np

from bridge.body.model_data import SMPL_JOINT_NAMES, BodyModelData
from bridge.errors import DsnetError

_HEIGHT_M = (1.0, 2.5)
_UNITS = {"millimetres": 1000.0, "centimetres": 100.0, "inches": 1 / 0.0254}
_LARGEST_BLEND_M = 2.0
"""What one beta, or one entry of R - I, may move a vertex by."""
_JOINT_OUTSIDE_M = 0.1
_WEIGHTS = (-0.01, 1.01)
_LEFT, _RIGHT = (SMPL_JOINT_NAMES.index(f"{side}_shoulder") for side in ("left", "right"))


def checked_person(data: BodyModelData) -> BodyModelData:
    """The model itself, if its mean body is a person in metres: y up, +x the body's left.

    Raises
    ------
    DsnetError
        If it is in another unit, turned, mirrored, or moves as no skin does.
    """
    size = np.ptp(data.v_template, axis=0)
    if not _HEIGHT_M[0] < size.max() < _HEIGHT_M[1]:
        raise _refused(data, f"a body of {size.max():.4g}", "a person in metres", _unit(size.max()))
    if size[2] > min(size[:2]):
        measures = " x ".join(f"{side:.2f}" for side in size)
        turn = "Turn it (from z up: (x, y, z) to (x, z, -y))"
        raise _refused(data, f"a body of {measures} m (x, y, z)", "y up, facing z", turn)
    if data.joints[_LEFT, 0] <= data.joints[_RIGHT, 0]:
        flaw = "a body whose left shoulder is not at +x of its right one"
        raise _refused(data, flaw, "+x the body's left", "It is mirrored or faces -z: turn it")
    low, high = data.weights.min(), data.weights.max()
    if low < _WEIGHTS[0] or high > _WEIGHTS[1]:
        raise _refused(data, f"skinning weights of {low:.3g} to {high:.3g}", "0 to 1")
    far = np.abs(data.joints - np.clip(data.joints, data.v_template.min(0), data.v_template.max(0)))
    if far.max() > _JOINT_OUTSIDE_M:
        raise _refused(data, f"a joint {far.max():.3g} m outside of the body", "joints inside")
    for field in ("shapedirs", "posedirs"):
        if (largest := np.abs(getattr(data, field)).max()) > _LARGEST_BLEND_M:
            bound = f"at most {_LARGEST_BLEND_M:g} m"
            raise _refused(data, f"{field} that move a vertex by {largest:.3g} m", bound)
    return data


def _unit(size: float) -> str:
    """The unit in which a body is as large as a person, if there is one."""
    for unit, per_m in _UNITS.items():
        if _HEIGHT_M[0] < size / per_m < _HEIGHT_M[1]:
            return f"It seems to be in {unit}: divide v_template, shapedirs and posedirs by it"
    return "Convert it to metres"


def _refused(
    data: BodyModelData,
    received: str,
    expected: str,
    remedy: str = "Use an intact SMPL model file",
) -> DsnetError:
    return DsnetError(f"body model {data.name}: {received}", expected, remedy)
