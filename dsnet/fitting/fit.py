"""Fit frequency, damping and preload of one subject's soft regions to markers.

A maximum a posteriori estimate by the output error method. Three numbers change a region: the
logarithms of factors of its frequency and damping ratio, and its preload. The region's nodes are
simulated under the loads of a pose from markers on bone, and their offsets at the markers are
compared with the recording. Skin that neighbouring limbs pull is solved for together with it.
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
from dsnet.fitting.recording import Clip, Recording, Series, clip_to_fit
from dsnet.fitting.tissue_patch import (
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
"""Standard deviations of the prior, for the two logarithms and for preload: of the population's
mean about the base model's constants (of preload: about `PRELOAD`, a sag of 30 to 40 mm for tissue
of 3.6 Hz), and of subjects about that mean."""
_MARKER_MM, _PULL_MM = 4.0, 8.0
"""Standard deviations of a marker's residual motion, and of skin pulled by a limb."""
_SAME_FRAMES = 5.0
"""Number of consecutive frames whose errors are correlated."""
_BLOCK_S = 1.5
"""Errors that are farther apart in time than this are independent."""
_MIN_WEIGHT = 0.02
"""Nodes that belong less than this to a region are left out."""
_STARTS = np.array([-0.7, -0.45, -0.2, 0.0, 0.2, 0.45])
"""Starting values of the logarithm of the frequency's factor, whose error has local minima."""
_ROUNDS = 2
_STEP = 0.01
"""Step of finite differences."""


@dataclass(frozen=True)
class Estimate:
    """The fit of one region to one subject's markers; stored in checkpoints."""

    found: list[float]
    """(3,) the estimated changes, the preload as its logit."""
    information: list[list[float]]
    """(3, 3) information of the data about the changes, scaled by the residual errors."""
    pull: list[float]
    """(3,) information times the estimate from the data alone."""
    base: list[float]
    """(2,) logarithms of the base model's frequency [Hz] and damping ratio for this subject."""
    reach: float
    """How much of a change the region's typical frequency and damping take on."""
    seconds: float
    motions: int
    left: float
    """Residual energy of the markers' motion, relative to the total."""
    doubt: str
    """Why the fit is uncertain, empty if it is not."""


def fit_subject(
    body: BodyModelData, base: TrainedPlus, recordings: Sequence[Recording]
) -> dict[str, Estimate]:
    """Fit each part of the body that has markers to one subject's recordings.

    Regions influence one another and the markers on bone, so each is fitted with the current
    estimates of the others, in several rounds.
    """
    regions = {part: Region.of(body, base, part) for part in SOFT}
    estimates: dict[str, Estimate] = {}
    for _ in range(_ROUNDS):
        model = PlusModel(with_changes(body, base, regions, _changes(estimates)), body)
        recordings, clips = zip(*(clip_to_fit(one, model) for one in recordings), strict=True)
        for part in SOFT:
            with_part = [clip for clip in clips if part in clip.series]
            if with_part:
                others = _changes({name: one for name, one in estimates.items() if name != part})
                current = with_changes(body, base, regions, others)
                betas = recordings[0].motion.betas
                fit = _Fit(body, current, betas, with_part, part, regions[part])
                estimates[part] = fit.estimate(estimates.get(part))
    return estimates


def _changes(estimates: Mapping[str, Estimate]) -> dict[str, list[float]]:
    return {part: one.found for part, one in estimates.items()}


class _Fit:
    """One region of one subject: errors of its markers, for several sets of changes at once."""

    def __init__(
        self,
        body: BodyModelData,
        model: TrainedPlus,
        betas: NDArray,
        clips: Sequence[Clip],
        part: str,
        region: Region,
    ) -> None:
        inside = region.weights > _MIN_WEIGHT
        laplacian = model.nodes.laplacian.toarray().astype(np.float64)
        # Simulate the region and its neighbours; nodes beyond them are fixed.
        nodes = np.flatnonzero(np.abs(laplacian) @ inside > 0)
        laplacian = laplacian[np.ix_(nodes, nodes)]
        self._region, self._whole = region, constants_of(body, model, betas)
        self._base = {name: values[nodes] for name, values in self._whole.items()}
        self._normals = shaped_normals(body, betas)[model.nodes.vertices[nodes]].astype(np.float64)
        columns = {name: self._base[name][:, None] for name in ("wave_speed", "bending")}
        coupled = coupling(columns, sp.csr_matrix(laplacian))
        self._unfitted = coupled, self._normals, self._base["normal_ratio"]
        self._softness = region.softness[nodes]
        self._clips = [(clip, clip.series[part]) for clip in clips]
        self._loads = [clip.load[:, nodes] for clip in clips]
        self._node_weights = [
            np.stack([one.node_weights[nodes] for one in series]) for _, series in self._clips
        ]

    def estimate(self, previous: Estimate | None) -> Estimate:
        """Fit the changes, starting from a previous estimate if there is one."""
        prior = np.array([0.0, 0.0, float(logit(PRELOAD))])
        prior_sd = np.hypot(POPULATION_SD, PEOPLE_SD) * [1, 1, logit_slope(PRELOAD)]
        if previous is None:
            starts = prior + _STARTS[:, None] * [1, 0, 0]
        else:
            starts = np.array([previous.found])
        costs = np.square((starts - prior) / prior_sd).sum(axis=1)
        if len(starts) > 1:
            costs += np.square(self._errors(starts)).sum(axis=0)
        # The unknowns are deviations from the prior's mean, in its standard deviations.
        solution = least_squares(
            lambda x: np.r_[self._errors((prior + prior_sd * x)[None])[:, 0], x],
            (starts[int(np.argmin(costs))] - prior) / prior_sd,
            jac=lambda x: np.vstack([self._slopes(prior + prior_sd * x) * prior_sd, np.eye(3)]),  # pyright: ignore[reportArgumentType]
            bounds=(-5, 5),
            max_nfev=15,
            xtol=1e-3,
            ftol=1e-4,
        )
        best = prior + prior_sd * solution.x
        slopes, error = self._slopes(best), self._errors(best[None])[:, 0]
        formal = slopes.T @ slopes
        inflation = _inflation(slopes, error, self._blocks(), formal + np.diag(prior_sd**-2.0))
        information = formal / inflation
        # At the optimum the gradients of data and prior cancel.
        pull = information @ best + solution.x / prior_sd / inflation
        series = [one for _, of_clip in self._clips for one in of_clip]
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
        """Errors (R, M) for M sets of changes (M, 3), in standard deviations."""
        constants = changed(self._base, self._softness, self._normals, sets)
        simulated = Patch(constants, *self._unfitted).simulate(self._loads, self._node_weights)
        errors = []
        for (clip, series), offsets_m in zip(self._clips, simulated, strict=True):
            for column, one in enumerate(series):
                local_mm = 1e3 * np.einsum("txy,tym->txm", one.rotations, offsets_m[:, column])
                errors += _residuals(one, faster(local_mm, clip.fps))
        return np.concatenate(errors)

    def _slopes(self, at: NDArray) -> NDArray[np.float64]:
        """Derivatives (R, 3) of the errors, by central differences."""
        errors = self._errors(at + np.vstack([np.eye(3), -np.eye(3)]) * _STEP)
        return (errors[:, :3] - errors[:, 3:]) / (2 * _STEP)

    def _blocks(self) -> NDArray[np.intp]:
        """(R,) index of the block of time that an error belongs to; -1 for pulls of limbs."""
        blocks = []
        for number, (clip, series) in enumerate(self._clips):
            for one in series:
                frames = np.flatnonzero(one.good).repeat(3) / (_BLOCK_S * clip.fps)
                pulls = np.full(3 * one.limbs.shape[1], -1)
                blocks += [1000 * number + frames.astype(np.intp), pulls]
        return np.concatenate(blocks)


def _inflation(slopes: NDArray, error: NDArray, blocks: NDArray, precision: NDArray) -> float:
    """Factor of the formal variance, because errors within a block of time are correlated."""
    scores = np.zeros((int(blocks.max()) + 1, slopes.shape[1]))
    np.add.at(scores, blocks[blocks >= 0], (slopes * error[:, None])[blocks >= 0])
    scores = scores[np.bincount(blocks[blocks >= 0], minlength=len(scores)) > 0]
    count, inverse = len(scores), np.linalg.inv(precision)
    if count < 2:
        return 4.0
    variance = scores.T @ scores * count / (count - 1)
    return max(1.0, float(np.trace(inverse @ variance) / np.trace(inverse @ (slopes.T @ slopes))))


def _residuals(series: Series, offsets_mm: NDArray) -> list[NDArray[np.float64]]:
    """Residuals of a marker's motion, and the pulls of limbs, which are solved for (variable
    projection); both in standard deviations."""
    sets, sd_mm = offsets_mm.shape[-1], _MARKER_MM * np.sqrt(_SAME_FRAMES)
    error = ((series.moved_mm[..., None] - offsets_mm)[series.good] / sd_mm).reshape(-1, 3 * sets)
    limbs = series.limbs[series.good] / sd_mm
    gram = limbs.T @ limbs + np.eye(limbs.shape[1]) / _PULL_MM**2
    pulls_mm = np.linalg.solve(gram, limbs.T @ error)
    return [(error - limbs @ pulls_mm).reshape(-1, sets), (pulls_mm / _PULL_MM).reshape(-1, sets)]
