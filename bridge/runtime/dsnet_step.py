"""The paper's DSNet, stepped: the network of its deployable graph, run by ONNX Runtime."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.exchange import load_weights
from bridge.exchange.dsnet import TrainedDsnet, load_trained_dsnet
from bridge.paper import N_BETAS
from bridge.runs import Artifact
from bridge.runtime.graphs.dsnet_body_graph import dsnet_layout, dsnet_step_graph
from bridge.runtime.graphs.onnx_builder import GraphSession
from bridge.runtime.graphs.onnx_graphs import decoder_graph
from bridge.runtime.motion_predictor import MotionRoad
from bridge.runtime.stepping import Codes, State

_BETAS, _MEMORY = slice(0, N_BETAS), slice(N_BETAS, None)


class DsnetModel:
    """A `Model` whose codes are latents (100,).

    Parameters
    ----------
    network : a trained DSNet.
    decoder : `latents` (B, 100) to `offsets` (B, V, 3), metres; None where only codes are asked.
    """

    look_ahead = 0
    codes_are_latents = True

    def __init__(self, network: TrainedDsnet, decoder: GraphSession | None = None) -> None:
        self._memory = dsnet_layout(network).size
        self._run = GraphSession(dsnet_step_graph(network), threads=1)
        self._decoder = decoder

    def reset(self, betas: NDArray, theta0: NDArray) -> State:
        """The network remembers nothing."""
        state = np.zeros((len(betas), N_BETAS + self._memory), np.float32)
        state[:, _BETAS] = betas
        return state

    def step(self, state: State, theta: NDArray) -> tuple[State, Codes]:
        """One step of the network for all."""
        betas = state[:, _BETAS]
        inputs = np.concatenate([betas, np.asarray(theta, np.float32)], axis=1)
        found = self._run(motion=inputs, state=state[:, _MEMORY])
        return np.concatenate([betas, found["next_state"]], axis=1), found["codes"]

    def reshaped(self, state: State, betas: NDArray) -> State:
        """The same past, of bodies betas (B, 10) from here on."""
        state = state.copy()
        state[:, _BETAS] = betas
        return state

    def stopped(self, state: State) -> State:
        """Nothing is owed."""
        return state

    def offsets_m(self, betas: NDArray, codes: Codes, theta: NDArray) -> NDArray[np.float32]:
        """Decoded."""
        assert self._decoder is not None
        return self._decoder(latents=codes)["offsets"]


def load_decoder(codec: Artifact) -> GraphSession:
    """The decoder of a finished `train-ae`: `latents` (B, 100) to `offsets` (B, V, 3), metres."""
    arrays = load_weights(codec.file("autoencoder.safetensors"))
    weights = {name.removeprefix("model."): array for name, array in arrays.items()}
    return GraphSession(decoder_graph(weights, codec.manifest["architecture"]))


def _open(artifacts: Mapping[str, Artifact], name: str, _: BodyModelData) -> DsnetModel:
    network = load_trained_dsnet(artifacts["train"], name)
    return DsnetModel(network, load_decoder(artifacts["train-ae"]))


DSNET = MotionRoad(("train", "train-ae"), "train", _open)
"""The paper's: latents by DSNet, offsets by the autoencoder's decoder."""
