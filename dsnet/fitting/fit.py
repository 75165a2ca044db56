"""Frequency, damping and preload of a person's soft regions: maximum a posteriori by output error.

Of each region the model's constants are changed by three numbers: logarithms of what its frequency
and its damping ratio are multiplied by, and the preload of its flesh. Flesh of the region's nodes
is rolled under the loads of a pose that follows bone, read at the markers and compared with them;
skin that the limbs beyond pull is solved for beside it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.optimize import least_squares

from bridge.body import BodyModelData
from bridge.tissue.oscillators import coupling
from bridge.tissue.shape import shaped_normals
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.fitting.evidence import Clip, Series, Take, evidence
from dsnet.fitting.flesh_patch import (
    Patch,
    Region,
    changed,
    constants_of,
    logit,
    logit_slope,
    with_changes,
)
from dsnet.markers.registration import SOFT
from dsnet.markers.segments import faster
from dsnet.prediction.models import PlusModel

PRELOAD = 1.8
POPULATION_SD, PEOPLE_SD = np.array([0.4, 0.35, 0.5]), np.array([0.2, 0.25, 0.3])
"""What is known before, in the logarithms and in preload: by how much people's mean lies beside the
base model's constants (of preload: beside `PRELOAD`, sag of 30 to 40 mm where flesh swings at
3.6 Hz), and how much people of one shape differ."""
_MARKER_MM, _PULL_MM = 4.0, 8.0
"""What of a marker's motion the law leaves, and how far a limb pulls skin."""
_SAME_FRAMES = 5.0
"""Neighbours in time whose errors are one error."""
_BLOCK_S = 1.5
"""Errors farther apart than this are different errors."""
_LEAST_SHARE = 0.02
_STARTS = np.array([-0.7, -0.45, -0.2, 0.0, 0.2, 0.45])
"""Of the frequency, whose error has valleys."""
_TURNS = 2
_STEP = 0.01
"""Of a derivative."""


@dataclass(frozen=True)
class Estimate:
    """What one person's markers say of a region."""

    found: list[float]
    """(3,) changes, the preload as its logit; a maximum a posteriori."""
    information: list[list[float]]
    """(3, 3) of the data about them, as wide as the errors that are left say."""
    pull: list[float]
    """(3,) information times the data's own estimate."""
    base: list[float]
    """(2,) logarithms of the base model's frequency [Hz] and damping ratio of this person."""
    reach: float
    """Part of a change that these two take."""
    seconds: float
    motions: int
    left: float
    """Part of the markers' energy that the fit leaves."""
    doubt: str


def fit_person(
    body: BodyModelData, base: TrainedPlus, takes: Sequence[Take]
) -> dict[str, Estimate]:
    """What one person's takes say of each part of the body that has markers.

    Regions move one another, and the markers on bone: each is fitted beside what was found of the
    others, in turns.
    """
    regions = {part: Region.of(body, base, part) for part in SOFT}
    found: dict[str, Estimate] = {}
    for _ in range(_TURNS):
        model = PlusModel(with_changes(body, base, regions, _changes(found)), body)
        takes, clips = zip(*(evidence(take, model) for take in takes), strict=True)
        for part in SOFT:
            there = [clip for clip in clips if part in clip.series]
            if there:
                others = _changes({name: one for name, one in found.items() if name != part})
                beside = with_changes(body, base, regions, others)
                betas, start = takes[0].motion.betas, found.get(part)
                fit = _Fit(body, beside, betas, there, part, regions[part])
                found[part] = fit.estimate(start)
    return found


def _changes(found: Mapping[str, Estimate]) -> dict[str, list[float]]:
    return {part: one.found for part, one in found.items()}


class _Fit:
    """One region of one person: errors of its markers, for several sets of changes at once."""

    def __init__(
        self,
        body: BodyModelData,
        model: TrainedPlus,
        betas: NDArray,
        clips: Sequence[Clip],
        part: str,
        region: Region,
    ) -> None:
        there = region.there > _LEAST_SHARE
        laplacian = model.nodes.laplacian.toarray().astype(np.float64)
        # What they pull at moves too; what lies beyond stands still.
        nodes = np.flatnonzero(np.abs(laplacian) @ there > 0)
        laplacian = laplacian[np.ix_(nodes, nodes)]
        self._region, self._whole = region, constants_of(body, model, betas)
        self._base = {name: values[nodes] for name, values in self._whole.items()}
        self._normals = shaped_normals(body, betas)[model.nodes.vertices[nodes]].astype(np.float64)
        columns = {name: self._base[name][:, None] for name in ("wave_speed", "bending")}
        coupled = coupling(columns, sp.csr_matrix(laplacian))
        self._unfitted = coupled, self._normals, self._base["normal_ratio"]
        self._shares = region.shares[nodes]
        self._clips = [(clip, clip.series[part]) for clip in clips]
        self._loads = [clip.load[:, nodes] for clip in clips]
        self._reading = [np.stack([one.reading[nodes] for one in s]) for _, s in self._clips]

    def estimate(self, known: Estimate | None) -> Estimate:
        """Fit, from what is `known` if anything is."""
        start = np.array([0.0, 0.0, float(logit(PRELOAD))])
        spread = np.hypot(POPULATION_SD, PEOPLE_SD) * [1, 1, logit_slope(PRELOAD)]
        starts = start + _STARTS[:, None] * [1, 0, 0] if known is None else np.array([known.found])
        costs = np.square((starts - start) / spread).sum(axis=1)
        if len(starts) > 1:
            costs += np.square(self._errors(starts)).sum(axis=0)
        # In units of what is known before.
        found = least_squares(
            lambda x: np.r_[self._errors((start + spread * x)[None])[:, 0], x],
            (starts[int(np.argmin(costs))] - start) / spread,
            jac=lambda x: np.vstack([self._slopes(start + spread * x) * spread, np.eye(3)]),  # pyright: ignore[reportArgumentType]
            bounds=(-5, 5),
            max_nfev=15,
            xtol=1e-3,
            ftol=1e-4,
        )
        best = start + spread * found.x
        slopes, error = self._slopes(best), self._errors(best[None])[:, 0]
        formal = slopes.T @ slopes
        inflation = _inflation(slopes, error, self._blocks(), formal + np.diag(spread**-2.0))
        information = formal / inflation
        # At the optimum the data's gradient is the prior's with another sign.
        pull = information @ best + found.x / spread / inflation
        series = [one for _, own in self._clips for one in own]
        energy = sum(float(np.square(one.moved_mm[one.good]).sum()) for one in series)
        typical, base = self._region.typical, self._whole
        return Estimate(
            found=best.tolist(),
            information=information.tolist(),
            pull=pull.tolist(),
            base=[
                float(typical @ np.log(base["omega"] / (2 * np.pi))),
                float(typical @ np.log(base["damping_ratio"])),
            ],
            reach=self._region.reach,
            seconds=round(sum(len(clip.load) / clip.fps for clip, _ in self._clips), 2),
            motions=len(self._clips),
            left=float(np.square(error).sum() / (energy / (_MARKER_MM**2 * _SAME_FRAMES))),
            doubt="; ".join(sorted({one.doubt for one in series} - {""})),
        )

    def _errors(self, sets: NDArray) -> NDArray[np.float64]:
        """(R, M) of M sets of changes (M, 3), in units of what is expected."""
        constants = changed(self._base, self._shares, self._normals, sets)
        rolled = Patch(constants, *self._unfitted).roll(self._loads, self._reading)
        found = []
        for (clip, series), offsets_m in zip(self._clips, rolled, strict=True):
            for column, one in enumerate(series):
                inside = 1e3 * np.einsum("txy,tym->txm", one.turns, offsets_m[:, column])
                found += _unexplained(one, faster(inside, clip.fps))
        return np.concatenate(found)

    def _slopes(self, at: NDArray) -> NDArray[np.float64]:
        """(R, 3) derivatives of the errors."""
        found = self._errors(at + np.vstack([np.eye(3), -np.eye(3)]) * _STEP)
        return (found[:, :3] - found[:, 3:]) / (2 * _STEP)

    def _blocks(self) -> NDArray[np.intp]:
        """(R,) which errors are one: of a moment of one motion; -1 for what is pulled."""
        found = []
        for number, (clip, series) in enumerate(self._clips):
            for one in series:
                frames = np.flatnonzero(one.good).repeat(3) / (_BLOCK_S * clip.fps)
                pulled = np.full(3 * one.pulls.shape[1], -1)
                found += [1000 * number + frames.astype(np.intp), pulled]
        return np.concatenate(found)


def _inflation(slopes: NDArray, error: NDArray, blocks: NDArray, whole: NDArray) -> float:
    """By how much wider than formal errors say: errors of one moment are one error."""
    scores = np.zeros((int(blocks.max()) + 1, slopes.shape[1]))
    np.add.at(scores, blocks[blocks >= 0], (slopes * error[:, None])[blocks >= 0])
    scores = scores[np.bincount(blocks[blocks >= 0], minlength=len(scores)) > 0]
    count, inverse = len(scores), np.linalg.inv(whole)
    if count < 2:
        return 4.0
    spread = scores.T @ scores * count / (count - 1)
    return max(1.0, float(np.trace(inverse @ spread) / np.trace(inverse @ (slopes.T @ slopes))))


def _unexplained(series: Series, offsets_mm: NDArray) -> list[NDArray[np.float64]]:
    """What is left of a marker's motion, and the pulls that were solved for (variable
    projection)."""
    sets, size = offsets_mm.shape[-1], _MARKER_MM * np.sqrt(_SAME_FRAMES)
    left = ((series.moved_mm[..., None] - offsets_mm)[series.good] / size).reshape(-1, 3 * sets)
    pulls = series.pulls[series.good] / size
    gram = pulls.T @ pulls + np.eye(pulls.shape[1]) / _PULL_MM**2
    solved = np.linalg.solve(gram, pulls.T @ left)
    return [(left - pulls @ solved).reshape(-1, sets), (solved / _PULL_MM).reshape(-1, sets)]
