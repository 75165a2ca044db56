"""Combine subjects' estimates of a region into the population's, with 90 % intervals.

A hierarchical normal model: each subject's changes are normally distributed about the population's
mean. Mean and spread are estimated by expectation maximisation from every subject's information, so
that subjects with few data have little weight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.tissue.oscillators import GRAVITY_M_S2
from dsnet.fitting.fit import PEOPLE_SD, POPULATION_SD, PRELOAD, Estimate
from dsnet.fitting.tissue_patch import logit, logit_slope, preload_of

_ROUNDS = 50
_PRIOR_COUNT = 4.0
"""Weight of the prior of the spread between subjects, as a number of subjects."""
_BIAS = np.array([0.04, 0.08, 0.1])
"""Bias of the method, which more subjects do not reduce, as `benchmarks.skin_markers` measures it;
in logarithms of frequency and damping ratio, and in preload."""
_INDICATIVE = 2.0
"""Factor of standard deviations where the segment's frame rests on soft tissue."""
_TOLD = 0.7
"""A mean counts as measured if its standard deviation is below this part of the prior's."""
_NINETY = 1.645
"""Half of a 90 % interval, in standard deviations."""


@dataclass(frozen=True)
class RegionFit:
    """Constants of one region for the population: value, low and high end of the 90 % interval.

    Its fields are keys of the artifact's manifest.
    """

    part: str
    people: int
    seconds: float
    frequency_hz: list[float]
    damping_ratio: list[float]
    preload: list[float]
    sag_mm: list[float]
    told: bool
    """Whether the markers determine it, and not mainly the prior."""
    doubt: str
    """Why it is uncertain, empty if it is not."""
    change: list[float]
    """(3,) changes of the model's region."""
    own: list[list[float]]
    """(3,) changes of each subject."""
    own_sd: list[list[float]]
    """(3,) their standard deviations, with the bias of the method."""


def combine(part: str, estimates: Sequence[Estimate]) -> RegionFit:
    """Combine the estimates of one part of the body from several subjects."""
    base = np.mean([one.base for one in estimates], axis=0)
    slope = np.array([1, 1, logit_slope(PRELOAD)])
    prior, prior_sd = np.array([0, 0, float(logit(PRELOAD))]), POPULATION_SD * slope
    between_sd = PEOPLE_SD * slope
    information = np.array([one.information for one in estimates])
    pull = np.array([one.pull for one in estimates])
    widening = _INDICATIVE if any("indicative" in one.doubt for one in estimates) else 1.0
    information, pull = information / widening**2, pull / widening**2
    for _ in range(_ROUNDS):
        mean, covariance, each, each_covariance = _step(
            information, pull, between_sd, prior, prior_sd
        )
        squares = np.square(each - mean).sum(axis=0)
        squares += np.einsum("nii->i", each_covariance)
        prior_squares = _PRIOR_COUNT * np.square(PEOPLE_SD * slope)
        between_sd = np.sqrt((prior_squares + squares) / (_PRIOR_COUNT + len(each)))
    preload = float(preload_of(mean[2]))
    bias = widening * _BIAS * [1, 1, logit_slope(preload)]
    mean_sd = np.sqrt(np.diag(covariance) + np.square(bias))
    low, high = (mean + sign * _NINETY * mean_sd for sign in (-1, 1))
    reach = estimates[0].reach
    ends = np.array([mean, low, high])
    hz, damping = (np.exp(base[k] + reach * ends[:, k]) for k in (0, 1))
    # The sag is preload g / w^2; these are the derivatives of its logarithm.
    by = np.array([-2, 0, 1 / logit_slope(preload) / preload])
    sag_m = preload * -GRAVITY_M_S2[1] / (2 * np.pi * hz[0]) ** 2
    sag_sd = np.sqrt(by @ covariance @ by + np.square(by * bias).sum())
    return RegionFit(
        part,
        len(estimates),
        round(sum(one.seconds for one in estimates), 1),
        _rounded(hz),
        _rounded(damping),
        _rounded(preload_of(ends[:, 2])),
        _rounded(1e3 * sag_m * np.exp(np.array([0, -1, 1]) * _NINETY * sag_sd)),
        bool(mean_sd[0] < _TOLD * prior_sd[0]),
        next((one.doubt for one in estimates if one.doubt), ""),
        mean.tolist(),
        each.tolist(),
        np.sqrt(np.einsum("nii->ni", each_covariance) + np.square(bias)).tolist(),
    )


def _step(
    information: NDArray, pull: NDArray, between_sd: NDArray, prior: NDArray, prior_sd: NDArray
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Mean and covariance of the population and of each subject, for a spread between subjects."""
    each_covariance = np.linalg.inv(information + np.diag(between_sd**-2.0))
    # The information about the population's mean, with the subjects' changes integrated out.
    marginal = information - information @ each_covariance @ information
    precision = np.diag(prior_sd**-2.0) + marginal.sum(axis=0)
    data = (pull - np.einsum("nxy,nyz,nz->nx", information, each_covariance, pull)).sum(axis=0)
    covariance = np.linalg.inv(precision)
    mean = covariance @ (data + prior / prior_sd**2)
    each = np.einsum("nxy,ny->nx", each_covariance, pull + mean / between_sd**2)
    return mean, covariance, each, each_covariance


def _rounded(values: NDArray) -> list[float]:
    return [float(f"{value:.4g}") for value in values]
