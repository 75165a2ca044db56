"""What a body in a file must be: a person in metres, y up, with a surface that has an outside."""

from __future__ import annotations

from functools import partial

import numpy as np

from bridge.body.containers import refused
from bridge.body.model_data import SMPL_JOINT_NAMES, BodyModelData
from bridge.body.surface_operators import volume_m3

_HEIGHT_M = (0.4, 2.5)
"""From a newborn's on."""
_ADULT_M = (1.0, 2.5)
_UNITS = {"millimetres": 1000.0, "centimetres": 100.0, "inches": 1 / 0.0254}
_LARGEST_BLEND_M = 2.0
"""What one beta, or one entry of R - I, may move a vertex by."""
_JOINT_OUTSIDE_M = 0.1
_WEIGHTS = (-0.01, 1.01)
_MOST_OPEN = 0.05
"""Of edges with one face, and of vertices with none: eye sockets and a mouth have fewer."""
_LEFT, _RIGHT = (SMPL_JOINT_NAMES.index(f"{side}_shoulder") for side in ("left", "right"))
_REMEDY = "Use an intact model file"


def checked_person(data: BodyModelData) -> BodyModelData:
    """The model itself, if its mean body is a person in metres: y up, +x the body's left."""
    amiss = partial(refused, data.name)
    size, template = np.ptp(data.v_template, axis=0), data.v_template
    largest = size.max()
    if not _HEIGHT_M[0] < largest < _HEIGHT_M[1]:
        units = (u for u, per_m in _UNITS.items() if _ADULT_M[0] < largest / per_m < _ADULT_M[1])
        unit = next(units, None)
        remedy = f"It seems to be in {unit}: divide v_template, shapedirs and posedirs by it"
        remedy = remedy if unit else "Convert it to metres"
        raise amiss(f"a body of {largest:.4g}", "a person in metres", remedy)
    if size[2] > min(size[:2]):
        measures = " x ".join(f"{side:.2f}" for side in size)
        turn = "Turn it (from z up: (x, y, z) to (x, z, -y))"
        raise amiss(f"a body of {measures} m (x, y, z)", "y up, facing z", turn)
    if data.joints[_LEFT, 0] <= data.joints[_RIGHT, 0]:
        flaw = "a body whose left shoulder is not at +x of its right one"
        raise amiss(flaw, "+x the body's left", "It is mirrored or faces -z: turn it")
    low, high = data.weights.min(), data.weights.max()
    if low < _WEIGHTS[0] or high > _WEIGHTS[1]:
        raise amiss(f"skinning weights of {low:.3g} to {high:.3g}", "0 to 1", _REMEDY)
    far = np.abs(data.joints - np.clip(data.joints, template.min(0), template.max(0)))
    if far.max() > _JOINT_OUTSIDE_M:
        raise amiss(f"a joint {far.max():.3g} m outside of the body", "joints inside", _REMEDY)
    for field in ("shapedirs", "expressiondirs", "posedirs"):
        if (moved := np.abs(getattr(data, field)).max(initial=0.0)) > _LARGEST_BLEND_M:
            bound = f"at most {_LARGEST_BLEND_M:g} m"
            raise amiss(f"{field} that move a vertex by {moved:.3g} m", bound, _REMEDY)
    return data


def checked_surface(data: BodyModelData) -> BodyModelData:
    """The model itself, if its faces are a body's skin, counter-clockwise from outside.

    It may be open in places and lie in pieces: SMPL-X has eyeballs, and sockets behind them.
    """
    faces, count = data.faces, data.vertex_count
    directed = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    keys = np.sort(directed, axis=1) @ [count, 1]
    _, edge, uses = np.unique(keys, return_inverse=True, return_counts=True)
    # Of two faces at an edge, each runs along it in its own direction.
    forward = np.bincount(edge, directed[:, 0] < directed[:, 1], len(uses))
    alone = count - len(np.unique(faces))
    if repeated := (directed[:, 0] == directed[:, 1]).reshape(-1, 3).any(axis=1).sum():
        flaw = f"{repeated} faces that repeat a vertex"
    elif (open_edges := (uses == 1).sum()) > _MOST_OPEN * len(uses):
        flaw = f"faces that leave holes, along {open_edges} of {len(uses)} edges"
    elif alone > _MOST_OPEN * count:
        flaw = f"{alone} vertices without a face"
    elif ((uses == 2) & (forward != 1)).any():
        flaw = "neighbouring faces that wind in opposite directions"
    elif volume_m3(data.v_template - data.v_template.mean(axis=0), faces) <= 0:
        flaw = "faces that wind clockwise seen from outside"
    else:
        return data
    skin = "a body's skin, wound counter-clockwise seen from outside"
    raise refused(data.name, flaw, skin, _REMEDY)
