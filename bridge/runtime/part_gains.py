"""Gains of the skin's dynamics, of the whole body and of its parts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.body import BodyModelData
from bridge.body.parts import GROUPS, PARTS, part_weights
from bridge.errors import DsnetError, did_you_mean
from bridge.options import Bounds

GAINS = Bounds(0, 20)
"""What a gain may be."""


def vertex_gain(
    body: BodyModelData, gain: float, part_gain: Sequence[str] = ()
) -> float | NDArray[np.float32]:
    """The gain of all vertices, or of each (V,).

    Parameters
    ----------
    gain : of all.
    part_gain : see `gains_of_parts`; on top of it.

    Raises
    ------
    DsnetError
        If a part is unknown or said twice, or a gain is no number from 0 to 20.
    """
    return blended_gain(body, gain, gains_of_parts(part_gain)) if part_gain else gain


def blended_gain(body: BodyModelData, gain: float, of_parts: ArrayLike) -> NDArray[np.float32]:
    """(V,) gains of vertices from one of all and those of `PARTS` (11,), which fade as they do."""
    return (gain * part_weights(body) @ np.asarray(of_parts)).astype(np.float32)


def gains_of_parts(part_gain: Sequence[str]) -> NDArray[np.float64]:
    """(11,) the gains of `PARTS`, 1 where none is said.

    Parameters
    ----------
    part_gain : `part=gain` of `PARTS` and `GROUPS`; a part's own counts more than its group's.

    Raises
    ------
    DsnetError
        If a part is unknown or said twice, or a gain is no number from 0 to 20.
    """
    said = dict(_part_gains(part_gain))
    of_parts = np.ones(len(PARTS))
    for group, parts in GROUPS.items():
        of_parts[[PARTS.index(part) for part in parts]] *= said.get(group, 1.0)
    for index, part in enumerate(PARTS):
        of_parts[index] = said.get(part, of_parts[index])
    return of_parts


def _part_gains(words: Sequence[str]) -> Iterator[tuple[str, float]]:
    met: set[str] = set()
    for word in words:
        part, _, text = word.partition("=")
        known = part in PARTS or part in GROUPS
        if not known or part in met:
            again = ", said before" if part in met else ""
            raise DsnetError(
                f"--part-gain {word}{again}",
                f"each of {', '.join((*PARTS, *GROUPS))} at most once",
                did_you_mean(part, (*PARTS, *GROUPS), "Pass --part-gain belly=2 chest=0.5."),
            )
        met.add(part)
        yield part, _gain(word, text)


def _gain(word: str, text: str) -> float:
    try:
        gain = float(text)
    except ValueError:
        gain = np.nan
    if not GAINS.hold(gain):
        raise DsnetError(
            f"--part-gain {word}", f"a gain of {GAINS}", "Pass --part-gain belly=2 chest=0.5."
        )
    return gain
