"""The springs of Spring-Decomposed Skinning, driven through the interface of its own code."""

from __future__ import annotations

import contextlib
import importlib
import io
import sys
import types
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.rivals.rig import HelperRig
from bridge.errors import DsnetError

_PACKAGE = "src"
_ASKED = ("skeleton", "helper_handler")
_NEEDED = (*_ASKED, "mass_spring")
_LARGEST_M = 5.0


@dataclass(frozen=True)
class SpringSettings:
    """The method's own settings, named as there where they are its."""

    stiffness: float
    damping: float
    mass_dscale: float
    """What is left of a mass's velocity after each frame."""
    compliance: float | None
    """Of the constraint that pulls a spring's ends together; None for no constraint."""


class HelperSprings:
    """Helpers' tips on springs.

    Parameters
    ----------
    code : folder of a checkout.
    parents : (24,) parent of each joint, -1 for the root.

    Raises
    ------
    DsnetError
        If the folder is not one.
    """

    def __init__(self, code: Path, parents: NDArray) -> None:
        self._skeleton, self._handler = import_checkout(code)
        self._tree = np.array([(p, j) for j, p in enumerate(parents) if p >= 0])

    def lag_m(
        self, rig: HelperRig, joints_m: NDArray, tips_m: NDArray, fps: float, set_: SpringSettings
    ) -> NDArray[np.float64] | None:
        """(T, H, 3) from where the skeleton has the tips to where springs do; None if they fly."""
        try:
            with np.errstate(all="ignore"), contextlib.redirect_stdout(io.StringIO()):
                lag_m = self._simulated(rig, joints_m, tips_m, fps, set_) - tips_m
        except AssertionError:  # its own check of forces
            return None
        return lag_m if np.isfinite(lag_m).all() and np.abs(lag_m).max() < _LARGEST_M else None

    def _simulated(
        self, rig: HelperRig, joints_m: NDArray, tips_m: NDArray, fps: float, set_: SpringSettings
    ) -> NDArray[np.float64]:
        skeleton = self._skeleton.create_skeleton(joints_m[0], self._tree)
        parents = [int(parent) for parent in rig.parents]
        helpers = np.array(self._skeleton.add_helper_bones(skeleton, list(tips_m[0]), parents))
        springs = self._handler.HelperBonesHandler(
            skeleton, helpers, point_spring=True, mass=1.0, stiffness=set_.stiffness,
            damping=set_.damping, mass_dscale=set_.mass_dscale, spring_dscale=1.0, dt=1 / fps,
            edge_constraint=set_.compliance is not None, compliance=set_.compliance or 0.0,
        )  # fmt: skip
        moved_m = np.empty_like(tips_m)
        for frame, (joints, tips) in enumerate(zip(joints_m, tips_m, strict=True)):
            # Two rows a bone, its ends; of bones that are no helpers the springs ask nothing.
            ends = np.zeros((2 * len(skeleton.rest_bones), 3))
            ends[2 * helpers], ends[2 * helpers + 1] = joints[rig.parents], tips
            moved_m[frame] = springs.update_bones(ends)[2 * helpers + 1]
        return moved_m


def import_checkout(code: Path) -> tuple[Any, Any]:
    """Its modules `skeleton` and `helper_handler`.

    Raises
    ------
    DsnetError
        If they do not lie there, or import what is not installed.
    """
    if missing := [n for n in _NEEDED if not (code / _PACKAGE / f"{n}.py").is_file()]:
        raise DsnetError(
            f"--code {code} without {_PACKAGE}/{missing[0]}.py",
            "a checkout of Spring-Decomposed Skinning",
            "Clone github.com/bartuakyurek/Spring-Decomposed-Skinning and pass its folder.",
        )
    # It draws springs with PyVista, which nothing here asks for.
    sys.modules.setdefault("pyvista", types.ModuleType("pyvista"))
    sys.path.insert(0, str(code.resolve()))
    try:
        skeleton, handler = (importlib.import_module(f"{_PACKAGE}.{n}") for n in _ASKED)
        return skeleton, handler
    except ImportError as error:
        raise DsnetError(
            f"--code {code}, which does not import ({error})",
            "its modules with what they need installed",
            "Install what is missing, or pass another checkout.",
        ) from error
    finally:
        sys.path.remove(str(code.resolve()))
        # So common a name must not stand in the way of another package's.
        for name in [n for n in sys.modules if n.partition(".")[0] == _PACKAGE]:
            del sys.modules[name]
