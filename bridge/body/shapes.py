"""Shape coefficients of a body that is asked for by name or by its measurements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict

import numpy as np
from numpy.typing import NDArray

from bridge.body.measurements import MEASURES, MeasuredBody, Measurements
from bridge.body.model_data import SHAPE_COUNT, BodyModelData
from bridge.errors import DsnetError, did_you_mean

SHAPES: Mapping[str, Mapping[str, float]] = {
    "tall": {"height": 1.08, "weight": 1.08**2},
    "short": {"height": 0.92, "weight": 0.92**2},
    "heavy": {"height": 1.0, "weight": 1.3},
    "slim": {"height": 1.0, "weight": 0.85},
    "pear": {"height": 1.0, "weight": 1.0, "chest": 0.97, "hips": 1.05},
    "apple": {"height": 1.0, "weight": 1.0, "waist": 1.05},
}
"""Named shapes: by what the measurements of the body model's mean person are multiplied. Of several
names, each later one of this table changes what the earlier ones made; what a name does not mention
is free to follow."""
FARTHEST_BETA = 3.0
"""Betas are in standard deviations of the people whom a body model was made from."""
CLOSE_ENOUGH = 0.5
"""In cm and kg: what may be missed."""
_PRIOR = 0.1
"""Of a beta of 1, in such misses: it chooses among shapes that measure the same, unmeasurably."""


def find_shape(body: BodyModelData, words: Sequence[str]) -> NDArray[np.float64]:
    """(10,) betas of a shape in words.

    Parameters
    ----------
    body : whose shape space it is.
    words : names of `SHAPES`, and measurements such as `height=182`, cm and kg (`MEASURES`), each
        once; a measurement counts more than what a name says of it.

    Raises
    ------
    DsnetError
        If a word is unknown, or no betas give what is asked; the message has what comes nearest.
    """
    named, stated = parse_shape(words)
    measured, betas = MeasuredBody(body), np.zeros(SHAPE_COUNT)
    wanted: dict[str, float] = {}
    for factors in named:
        now = asdict(measured(betas))
        wanted |= {name: factor * now[name] for name, factor in factors.items()}
        betas = betas_that_measure(measured, wanted, betas)
    return betas_that_measure(measured, wanted | stated, betas) if stated else betas


def parse_shape(words: Sequence[str]) -> tuple[list[Mapping[str, float]], dict[str, float]]:
    """What words say: the rows of `SHAPES`, in its order, and measurements by name.

    Raises
    ------
    DsnetError
        If one is unknown or said twice.
    """
    named = _named([word for word in words if "=" not in word])
    return named, _stated([word for word in words if "=" in word])


def betas_that_measure(
    measured: MeasuredBody, wanted: Mapping[str, float], start: NDArray | None = None
) -> NDArray[np.float64]:
    """(10,) betas nearest to zero, none farther than `FARTHEST_BETA`, with given measurements.

    Parameters
    ----------
    measured : the body model.
    wanted : some of `MEASURES`, cm and kg; the others are free.
    start : (10,) betas to search from.

    Raises
    ------
    DsnetError
        If none come closer than `CLOSE_ENOUGH`; the message has what comes nearest.
    """

    # Importing it takes longer than the first frames of a motion, which need no search.
    from scipy.optimize import least_squares

    def misses(betas: NDArray) -> NDArray:
        found = asdict(measured(betas))
        return np.array([found[name] - value for name, value in wanted.items()])

    def residuals(betas: NDArray) -> NDArray:
        return np.concatenate([misses(betas) / CLOSE_ENOUGH, _PRIOR * betas])

    first = np.zeros(SHAPE_COUNT) if start is None else start
    limits = (-FARTHEST_BETA, FARTHEST_BETA)
    betas = least_squares(residuals, first, bounds=limits, xtol=1e-4, ftol=1e-6).x
    if np.abs(misses(betas)).max(initial=0.0) > CLOSE_ENOUGH:
        raise _out_of_reach(wanted, measured(betas))
    return betas


def _named(names: Sequence[str]) -> list[Mapping[str, float]]:
    """What the names say, in the table's order."""
    for name in names:
        if name not in SHAPES:
            raise DsnetError(
                f"shape {name!r}",
                f"{', '.join(SHAPES)}, or a measurement such as height=182",
                did_you_mean(name, SHAPES, "See docs/animation.md."),
            )
    return [factors for name, factors in SHAPES.items() if name in names]


def _stated(words: Sequence[str]) -> dict[str, float]:
    stated: dict[str, float] = {}
    for word in words:
        name, _, text = word.partition("=")
        if name not in MEASURES or name in stated:
            again = " a second time" if name in stated else ""
            raise DsnetError(
                f"measurement {word!r}{again}",
                f"each of {', '.join(MEASURES)} at most once",
                did_you_mean(name, MEASURES, "Write height=182, in cm; weight in kg."),
            )
        stated[name] = _number(word, text)
    return stated


def _number(word: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not 0 < value < 1000:
        raise DsnetError(
            f"measurement {word!r}", "a number of cm or kg", "Write height=182 weight=80."
        )
    return value


def _out_of_reach(wanted: Mapping[str, float], nearest: Measurements) -> DsnetError:
    asked = " ".join(f"{name}={value:.1f}" for name, value in wanted.items())
    return DsnetError(
        f"a shape of {asked}",
        f"one that {SHAPE_COUNT} betas within {FARTHEST_BETA:g} give (the nearest has {nearest})",
        "Ask for less, or for fewer measurements; --betas gives any shape.",
    )
