"""`dsnet_plus`, stepped: its deployable graph without the skin, run by ONNX Runtime."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.runs import Artifact
from bridge.runtime.graphs.onnx_builder import GraphSession
from bridge.runtime.graphs.plus_graph import plus_step_graph, step_layout
from bridge.runtime.motion_predictor import MotionRoad
from bridge.runtime.stepping import Codes, State
from bridge.tissue.trained_plus import TrainedPlus

_PLACE = slice(-3, None)
"""Of theta: where the root is. Of a state: where it was at first, as float32 knows places near
the origin best."""


class PlusModel:
    """A `Model` whose codes are offsets (3, K) of the nodes, metres.

    A frame's load is smoothed over poses that lie `look_ahead` frames ahead at most, and its
    acceleration needs the pose after: it moves the next frame's offsets.

    Parameters
    ----------
    model : a trained `dsnet_plus`.
    body : the body model that it was trained with.
    threads : its operations are small: for one character threads would wait for one another.
    """

    codes_are_latents = False

    def __init__(self, model: TrainedPlus, body: BodyModelData, threads: int = 1) -> None:
        self.look_ahead = model.look_ahead
        self.trained, self._body, self._layout = model, body, step_layout(model)
        self._run = GraphSession(plus_step_graph(model, body), threads)

    def __reduce__(self) -> tuple[type, tuple[TrainedPlus, BodyModelData]]:
        return type(self), (self.trained, self._body)

    def reset(self, betas: NDArray, theta0: NDArray) -> State:
        """The graph settles them in their first step: some 10 ms each."""
        state = np.zeros((len(betas), self._layout.size + 3), np.float32)
        state[:, self._layout.columns("betas")] = betas
        state[:, _PLACE] = theta0[:, _PLACE]
        return state

    def step(self, state: State, theta: NDArray) -> tuple[State, Codes]:
        """All with one product by the nodes' coupling."""
        about_start = np.array(theta, np.float64)
        about_start[:, _PLACE] -= state[:, _PLACE]
        found = self._run(
            theta=about_start.astype(np.float32),
            betas=state[:, self._layout.columns("betas")],
            state=state[:, : self._layout.size],
        )
        return np.concatenate([found["next_state"], state[:, _PLACE]], 1), found["codes"]

    def stopped(self, state: State) -> State:
        """Nodes that have not moved have no acceleration where they stay."""
        still = state.copy()
        still[:, self._layout.columns("moves")] = 0
        return still

    def offsets_m(self, betas: NDArray, codes: Codes, theta: NDArray) -> NDArray[np.float32]:
        """Spread over the skin, and the static part."""
        offsets_m = self.trained.nodes.spread(codes.transpose(0, 2, 1))
        static_m = self.trained.static_m(self._body, betas, theta)
        return offsets_m if static_m is None else offsets_m + static_m


def _open(artifacts: Mapping[str, Artifact], _: str, body: BodyModelData) -> PlusModel:
    return PlusModel(TrainedPlus.load(artifacts["train_plus"]), body)


PLUS = MotionRoad(("train_plus",), "train", _open)
"""The better one: oscillators on the skin, learned from aligned offsets."""
