"""Spring-Decomposed Skinning (SGP 2025, MIT licence): helper bones on springs.

Its springs run as they are, from a checkout. As in its own comparison with bodies
(`demo/dfaust_comparison_demo.py`) a spring of no length holds each helper's tip, and vertices
follow tips by the helpers' weights. Unlike there the tips turn with their bones, and what is
added is how far the springs leave a tip behind, not its step from the last frame.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from benchmarks.rivals.rig import HelperRig, carried_by_skeleton, helper_rig
from benchmarks.rivals.rival import MotionClip
from benchmarks.rivals.springs import HelperSprings, SpringSettings
from bridge.body import BodyModelData
from bridge.body.posing import Smpl
from bridge.errors import DsnetError
from bridge.motion import unpack_theta
from bridge.motion.cuts import predict_between_cuts
from bridge.tissue.nodes import farthest_points

NAME, LABEL = "sds", "Spring-Decomposed Skinning, helper bones"
_COMPARED_VERTICES = 600
_BLOCK_FRAMES = 64


@dataclass(frozen=True)
class HelperSettings:
    """Settings, rig and the size of the effect."""

    springs: SpringSettings
    helpers: int
    power: float
    """Of the flesh's depth in skinning weights."""
    gain: float
    """`JIGGLE_SCALE` there."""


@dataclass(frozen=True)
class Grid:
    """What is tried, every combination: about the best of a wider and coarser grid."""

    helpers: tuple[int, ...] = (16, 40, 80)
    powers: tuple[float, ...] = (1.0, 2.0, 3.0)
    stiffness: tuple[float, ...] = (2000.0, 4000.0, 8000.0)
    damping: tuple[float, ...] = (0.0, 20.0)
    mass_dscale: tuple[float, ...] = (0.1, 0.2, 0.3)
    compliance: tuple[float | None, ...] = (None, 0.001)

    def springs(self) -> Iterator[SpringSettings]:
        """Every setting of the springs."""
        values = (self.stiffness, self.damping, self.mass_dscale, self.compliance)
        return itertools.starmap(SpringSettings, itertools.product(*values))

    def __len__(self) -> int:
        return len(self.helpers) * len(list(self.springs()))


class SpringDecomposedSkinning:
    """The rival.

    Parameters
    ----------
    code : folder of a checkout.

    Raises
    ------
    DsnetError
        If the folder is not one.
    """

    name, label = NAME, LABEL

    def __init__(self, code: Path, body: BodyModelData, grid: Grid | None = None) -> None:
        self._body, self._grid = body, grid or Grid()
        self._springs = HelperSprings(code, body.parents)
        self._chosen: HelperSettings | None = None
        self._rigs = {count: helper_rig(body, count) for count in self._grid.helpers}

    def choose(self, clips: Sequence[MotionClip]) -> list[str]:
        """Try the grid; the gain is each setting's best one."""
        with tqdm(total=len(self._grid), desc=NAME, unit="setting", disable=None) as progress:
            found = [one for count in self._rigs for one in self._tried(count, clips, progress)]
        if not found:
            raise DsnetError("springs that fly apart", "a setting that stays", "Widen the grid.")
        r2, self._chosen = max(found, key=lambda one: one[0])
        return self._clauses(self._chosen, r2)

    def _tried(
        self, count: int, clips: Sequence[MotionClip], progress: tqdm
    ) -> Iterator[tuple[float, HelperSettings]]:
        """R² on the clips of every setting with which no spring flies apart."""
        rig = self._rigs[count]
        trials = [_Trial(self._body, rig, clip, self._grid.powers) for clip in clips]
        for springs in self._grid.springs():
            progress.update()
            lags_m = [self._springs.lag_m(rig, *trial.motion, springs) for trial in trials]
            stayed = [
                (t, lag_m) for t, lag_m in zip(trials, lags_m, strict=True) if lag_m is not None
            ]
            if len(stayed) < len(trials):
                continue
            for power in self._grid.powers:
                r2, gain = _fit([trial.against(lag_m, power) for trial, lag_m in stayed])
                yield r2, HelperSettings(springs, count, power, gain)

    def offsets_m(self, betas: NDArray, theta: NDArray, fps: float) -> NDArray[np.float32]:
        """(T, V, 3), after `choose`; after a cut the springs start anew, from rest."""
        return predict_between_cuts(lambda piece: self._piece_m(betas, piece, fps), theta)

    def _piece_m(self, betas: NDArray, theta: NDArray, fps: float) -> NDArray[np.float32]:
        if self._chosen is None:
            raise ValueError("no settings were chosen")
        rig = self._rigs[self._chosen.helpers]
        motion = (*carried_by_skeleton(rig, self._body, betas, theta), fps)
        lag_m = self._springs.lag_m(rig, *motion, self._chosen.springs)
        if lag_m is None:
            raise DsnetError(
                f"{self._chosen.springs}, with which springs fly apart in a motion",
                "springs that stay",
                "Choose by more clips, or by a narrower grid.",
            )
        weights = rig.weights(self._chosen.power)
        person = Smpl(self._body, dtype=np.float64).person(betas)
        parts = []
        for start in range(0, len(theta), _BLOCK_FRAMES):
            rows = slice(start, start + _BLOCK_FRAMES)
            world_m = self._chosen.gain * np.einsum("vh,thx->tvx", weights, lag_m[rows])
            _, linear = person.skin(*unpack_theta(np.asarray(theta[rows], np.float64)))
            parts.append(np.linalg.solve(linear, world_m[..., None])[..., 0].astype(np.float32))
        return np.concatenate(parts)

    def _clauses(self, chosen: HelperSettings, r2: float) -> list[str]:
        springs = chosen.springs
        pulled = "none" if springs.compliance is None else f"{springs.compliance:g}"
        return [
            "its springs run as they are, training-free, one spring of no length at each helper's "
            "tip, no gravity, at rest in the first frame",
            f"{chosen.helpers} helpers spread over the flesh by farthest points in place of a rig "
            "made by hand; weights by distance along the skin times depth over the bone to the "
            f"power {chosen.power:g}",
            f"stiffness {springs.stiffness:g}, damping {springs.damping:g}, velocity kept "
            f"{springs.mass_dscale:g}, compliance {pulled}, size of the effect {chosen.gain:.2f}: "
            f"of {len(self._grid)} simulations of the validation clip, each with "
            f"{len(self._grid.powers)} powers, the best (R² {r2:.2f} there)",
        ]


class _Trial:
    """A clip at some vertices: enough to tell settings apart."""

    def __init__(
        self, body: BodyModelData, rig: HelperRig, clip: MotionClip, powers: Sequence[float]
    ) -> None:
        count = min(_COMPARED_VERTICES, len(body.v_template))
        chosen = farthest_points(np.asarray(body.v_template, np.float64), count)
        self.motion = (*carried_by_skeleton(rig, body, clip.betas, clip.theta), clip.fps)
        person = Smpl(body, chosen, np.float64).person(clip.betas)
        _, linear = person.skin(*unpack_theta(np.asarray(clip.theta, np.float64)))
        self._to_rest = np.linalg.inv(linear)
        self._weights = {power: rig.weights(power)[chosen] for power in powers}
        self._true_m = np.asarray(clip.offsets_m[:, chosen], np.float64)

    def against(self, lag_m: NDArray, power: float) -> tuple[NDArray, NDArray]:
        """Offsets (T, P, 3) that the tips make, and those that there are."""
        world_m = np.einsum("vh,thx->tvx", self._weights[power], lag_m)
        return np.einsum("tvxy,tvy->tvx", self._to_rest, world_m), self._true_m


def _fit(pairs: Sequence[tuple[NDArray, NDArray]]) -> tuple[float, float]:
    """R² of the offsets at the gain that suits them best, which is not negative; and that gain."""
    size = sum(float(np.square(made).sum()) for made, _ in pairs)
    common = sum(float((made * true).sum()) for made, true in pairs)
    gain = max(common / size, 0.0) if size else 0.0
    missed = sum(float(np.square(gain * made - true).sum()) for made, true in pairs)
    return 1 - missed / sum(float(np.square(true).sum()) for _, true in pairs), gain
