"""`dsnet_plus` applied to whole motions, a few frames in memory at a time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.runs import Artifact
from bridge.runtime.motion_predictor import FRAMES_AT_ONCE, MotionRoad, Prediction
from bridge.tissue.load import node_loads
from bridge.tissue.oscillators import FPS, NodeMechanics, OscillatorSheet
from bridge.tissue.trained_plus import TrainedPlus

Piece = NDArray[np.float32]


class PlusMotionPredictor:
    """A trained `dsnet_plus` on the body that it moves."""

    def __init__(self, model: TrainedPlus, body: BodyModelData) -> None:
        self._model, self._body = model, body

    def __call__(self, theta: NDArray, betas: NDArray) -> Prediction:
        """Offsets: those of the oscillators at the nodes, spread over the skin, and static ones."""
        return Prediction(self._offsets_m(theta, betas))

    def _offsets_m(self, theta: NDArray, betas: NDArray) -> Iterator[Piece]:
        mechanics = self._model.mechanics(self._body, betas)
        sheet = OscillatorSheet(mechanics, self._model.nodes.laplacian)
        first = node_loads(self._body, self._model.nodes.vertices, betas, theta[:1], FPS)
        rest, start = mechanics.felt(first)[0], 0
        for at_nodes in rolled(sheet, self._loads(mechanics, theta, betas), rest):
            part = theta[start : start + len(at_nodes)]
            offsets_m = self._model.nodes.spread(at_nodes)
            static_m = self._model.static_m(self._body, betas, part)
            yield offsets_m if static_m is None else offsets_m + static_m
            start += len(part)

    def _loads(self, mechanics: NodeMechanics, theta: NDArray, betas: NDArray) -> Iterator[Piece]:
        """(T', K, 3) of frames that follow one another, each piece from a window that has besides
        what its accelerations and its smoothing in time look at."""
        beside = len(mechanics.taps) + mechanics.look_ahead + 1
        vertices = self._model.nodes.vertices
        for start in range(0, len(theta), FRAMES_AT_ONCE):
            first = max(start - beside, 0)
            window = theta[first : start + FRAMES_AT_ONCE + beside]
            load = mechanics.load(node_loads(self._body, vertices, betas, window, FPS))
            yield load[start - first :][:FRAMES_AT_ONCE]


def rolled(sheet: OscillatorSheet, loads: Iterable[Piece], rest: NDArray) -> Iterator[Piece]:
    """What `sheet.roll` gives for pieces of loads (T', K, 3), from rest under `rest` (K, 3)."""
    now = before = sheet.settled(rest)
    felt = None
    for piece in loads:
        found = np.empty_like(piece)
        for row, load in enumerate(piece):
            if felt is not None:
                now, before = sheet.frame(now, before, felt)
            found[row], felt = now, load
        yield found


def _open(artifacts: Mapping[str, Artifact], _: str, body: BodyModelData) -> PlusMotionPredictor:
    return PlusMotionPredictor(TrainedPlus.load(artifacts["train_plus"]), body)


PLUS = MotionRoad(("train_plus",), "train", _open)
"""The better one: oscillators on the skin, learned from aligned offsets."""
