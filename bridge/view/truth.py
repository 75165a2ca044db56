"""The simulated truth, to be looked at beside predictions: nothing is computed from it but errors.

Apart from evaluation this is the one reader, and what it reads reaches no predictor.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.measure.pipelines import MotionArrays
from bridge.runs import Run


@dataclass(frozen=True, eq=False)
class TrueMotion:
    """What really moved in a synthetic sequence of T frames."""

    theta: NDArray[np.floating]
    """(T, 69) true pose."""
    betas: NDArray[np.floating]
    """(10,) true shape."""
    offsets_m: NDArray[np.float32]
    """(T, V, 3) true offsets in the rest pose, metres."""


TRUTH = "truth"
"""The name by which it is shown, as predictors have theirs; that of its artifact."""
ReadTruth = Callable[[str], TrueMotion]
"""The truth of a sequence by name."""


def open_truth(run: Run, origin: str) -> tuple[Mapping[str, int], ReadTruth]:
    """Lengths of the sequences whose truth is known, by name, and what reads one of them.

    Parameters
    ----------
    origin : of the run's meshes; the truth is that of the run's own corpus, not of licensed ones.

    Raises
    ------
    DsnetError
        If the truth is damaged.
    """
    if origin != "synthetic" or not run.finished(TRUTH):
        return {}, _no_truth
    truth = MotionArrays.of(run.artifact(TRUTH))

    def read(name: str) -> TrueMotion:
        frames = slice(0, truth.places[name].length)
        offsets_m = np.asarray(truth.offsets_m(name, frames), np.float32)
        return TrueMotion(truth.frames("theta", name, frames), truth.betas(name), offsets_m)

    return {name: place.length for name, place in truth.places.items()}, read


def _no_truth(name: str) -> TrueMotion:
    raise KeyError(name)
