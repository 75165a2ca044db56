"""Python's rules for skeletons as data: by them a page that is a file reads BVH in JavaScript.

They are the constants of the modules that do it, private ones too, each by its name without the
first underscore: names of joints, bones, patterns and bounds stand in one place.
"""

from __future__ import annotations

import json
import re
from types import ModuleType
from typing import Any

import numpy as np

from bridge.motion import cuts, rest_poses, retargeting, skeletons
from bridge.motion.readers import bvh

_MODULES = (bvh, cuts, rest_poses, retargeting, skeletons)


def skeleton_rules() -> bytes:
    """JSON: constants by module and name, and SMPL's mean joints (22, 3) at rest, metres."""
    rules: dict[str, Any] = {
        module.__name__.rpartition(".")[2]: _constants(module) for module in _MODULES
    }
    rules |= {"mean_joints": retargeting.mean_joints().tolist()}
    return json.dumps(rules, default=_as_json).encode()


def _constants(module: ModuleType) -> dict[str, Any]:
    named = {name.strip("_"): value for name, value in vars(module).items() if name.isupper()}
    return {name: value for name, value in named.items() if not callable(value)}


def _as_json(value: Any) -> Any:
    match value:
        case set():
            return sorted(value)
        case np.ndarray():
            return value.tolist()
        case re.Pattern():
            return value.pattern
    return None
