"""From many people's estimates of a region to what they share, with intervals.

People differ: each one's constants are the population's and something of their own, normal in the
scale of the changes. Mean and spread are found by expectation and maximisation, from what every
person's markers say (information form, so that who says little weighs little).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.tissue.oscillators import GRAVITY_M_S2
from dsnet.fitting.fit import PEOPLE_SD, POPULATION_SD, PRELOAD, Estimate
from dsnet.fitting.flesh_patch import logit, logit_slope, preload_of

_ROUNDS = 50
_WORTH = 4.0
"""People that the spread that was assumed counts as."""
_BIAS = np.array([0.04, 0.08, 0.1])
"""Of the method itself, which more people do not take away: `benchmarks.skin_markers` measures it.
In logarithms of frequency and damping ratio, and in preload."""
_INDICATIVE = 2.0
"""How much wider, where the frame itself rides on flesh."""
_TOLD = 0.7
"""A mean whose deviation is less than this part of what was assumed is the data's."""
_NINETY = 1.645


@dataclass(frozen=True)
class Fitted:
    """What people share of one region: values with the ends of their 90 % interval."""

    part: str
    people: int
    seconds: float
    frequency_hz: list[float]
    damping_ratio: list[float]
    preload: list[float]
    sag_mm: list[float]
    told: bool
    """Whether markers say it, and not what was assumed before."""
    doubt: str
    change: list[float]
    """(3,) of the model's region."""
    own: list[list[float]]
    """(3,) of each person, as far as markers tell them from the others."""
    own_sd: list[list[float]]
    """How far off each may be, the method's bias included."""


def share(part: str, estimates: Sequence[Estimate]) -> Fitted:
    """What the people of some estimates of one part have in common."""
    base = np.mean([one.base for one in estimates], axis=0)
    slope = np.array([1, 1, logit_slope(PRELOAD)])
    before, prior = POPULATION_SD * slope, np.array([0, 0, float(logit(PRELOAD))])
    spread = PEOPLE_SD * slope
    information = np.array([one.information for one in estimates])
    pull = np.array([one.pull for one in estimates])
    wide = _INDICATIVE if any("indicative" in one.doubt for one in estimates) else 1.0
    information, pull = information / wide**2, pull / wide**2
    for _ in range(_ROUNDS):
        mean, covariance, own, own_covariance = _step(information, pull, spread, prior, before)
        excess = np.square(own - mean).sum(axis=0)
        excess += np.einsum("nii->i", own_covariance)
        known = _WORTH * np.square(PEOPLE_SD * slope)
        spread = np.sqrt((known + excess) / (_WORTH + len(own)))
    preload = float(preload_of(mean[2]))
    bias = wide * _BIAS * [1, 1, logit_slope(preload)]
    deviation = np.sqrt(np.diag(covariance) + np.square(bias))
    low, high = (mean + sign * _NINETY * deviation for sign in (-1, 1))
    reach = estimates[0].reach
    ends = np.array([mean, low, high])
    hz, damping = (np.exp(base[k] + reach * ends[:, k]) for k in (0, 1))
    # Sag is preload g / w^2.
    by = np.array([-2, 0, 1 / logit_slope(preload) / preload])
    sag_m = preload * -GRAVITY_M_S2[1] / (2 * np.pi * hz[0]) ** 2
    sag_sd = np.sqrt(by @ covariance @ by + np.square(by * bias).sum())
    return Fitted(
        part,
        len(estimates),
        round(sum(one.seconds for one in estimates), 1),
        _rounded(hz),
        _rounded(damping),
        _rounded(preload_of(ends[:, 2])),
        _rounded(1e3 * sag_m * np.exp(np.array([0, -1, 1]) * _NINETY * sag_sd)),
        bool(deviation[0] < _TOLD * before[0]),
        next((one.doubt for one in estimates if one.doubt), ""),
        mean.tolist(),
        own.tolist(),
        np.sqrt(np.einsum("nii->ni", own_covariance) + np.square(bias)).tolist(),
    )


def _step(
    information: NDArray, pull: NDArray, spread: NDArray, prior: NDArray, before: NDArray
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """The population's mean and covariance, and each person's, for a spread over people."""
    inner = np.linalg.inv(information + np.diag(spread**-2.0))
    seen = information - information @ inner @ information
    precision = np.diag(before**-2.0) + seen.sum(axis=0)
    told = (pull - np.einsum("nxy,nyz,nz->nx", information, inner, pull)).sum(axis=0)
    covariance = np.linalg.inv(precision)
    mean = covariance @ (told + prior / before**2)
    own = np.einsum("nxy,ny->nx", inner, pull + mean / spread**2)
    return mean, covariance, own, inner


def _rounded(values: NDArray) -> list[float]:
    return [float(f"{value:.4g}") for value in values]
