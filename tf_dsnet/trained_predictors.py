"""The predictors that a run has trained, on every sequence, here or on the nodes of a cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body import load_body_model
from bridge.motion.cuts import predict_between_cuts
from bridge.runs import Artifact
from bridge.runs.files import ArrayFile
from bridge.runs.workers import on_any_node, worker_pool
from tf_dsnet.predictors import PredictMotion, load_predictor


@dataclass(frozen=True)
class Performance:
    """One sequence as a predictor is given it."""

    start: int
    """Row of its first frame among all."""
    theta: NDArray[np.float32]
    """(T, 69)."""
    betas: NDArray[np.float32]
    """(10,)."""


@dataclass(frozen=True, eq=False)
class TrainedPredictors:
    """Another process is sent the artifact's place; networks are loaded where they predict."""

    train: Artifact
    names: tuple[str, ...]
    body_path: Callable[[], Path]
    """Of the run's body model, for which most predictors never ask."""

    @cached_property
    def by_name(self) -> dict[str, PredictMotion]:
        """The networks.

        Raises
        ------
        DsnetError
            If one was never trained, or its weights are damaged.
        """
        body = cache(lambda: load_body_model(str(self.body_path())))
        return {name: load_predictor(self.train, name, body) for name in self.names}

    def __reduce__(self) -> tuple[Any, ...]:
        return TrainedPredictors, (self.train, self.names, self.body_path)

    def latents(self, name: str, one: Performance) -> NDArray[np.float32]:
        """Latents (T, 100) from a fresh state, and so after a cut."""
        predict = self.by_name[name]
        return predict_between_cuts(lambda piece: predict(piece, one.betas), one.theta)

    def write(self, performances: Iterable[Performance], latents: Mapping[str, ArrayFile]) -> None:
        """Write the latents of all sequences under each predictor."""
        with worker_pool(on_any_node("serial"), (self, latents)) as pool:
            for _ in pool.map(_write, performances):
                pass


def _write(
    tools: tuple[TrainedPredictors, Mapping[str, ArrayFile]], performance: Performance
) -> None:
    predictors, latents = tools
    for name, file in latents.items():
        file.write(performance.start, predictors.latents(name, performance))
