"""The paper's DSNet, stepped: the network of its deployable graph, run by ONNX Runtime."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.exchange import load_weights
from bridge.exchange.input_kinds import POSES, InputKind
from bridge.exchange.trained_dsnet import TrainedDsnet, load_trained_dsnet
from bridge.paper import N_BETAS, THETA_SIZE
from bridge.runs import Artifact
from bridge.runtime.graphs.dsnet_body_graph import dsnet_layout, dsnet_step_graph
from bridge.runtime.graphs.onnx_builder import GraphSession
from bridge.runtime.graphs.onnx_graphs import decoder_graph
from bridge.runtime.motion_predictor import MotionRoad
from bridge.runtime.stepping import Codes, State


class DsnetModel:
    """A `Model` whose codes are latents (100,).

    Parameters
    ----------
    network : a trained DSNet, told of poses or of their differences.
    decoder : `latents` (B, 100) to `offsets` (B, V, 3), metres; None where only codes are asked.
    """

    look_ahead = 0
    codes_are_latents = True

    def __init__(self, network: TrainedDsnet, decoder: GraphSession | None = None) -> None:
        self._kind, size = network.input_kind, dsnet_layout(network).size
        self._memory, self._betas = slice(size), slice(size, size + N_BETAS)
        """Columns of a state; after them, for `_Past`, what poses were before."""
        self._past = _Past(size + N_BETAS)
        self._run = GraphSession(dsnet_step_graph(network), threads=1)
        self._decoder = decoder

    def reset(self, betas: NDArray, theta0: NDArray) -> State:
        """The network remembers nothing."""
        told = self._past.begun(theta0) if self._kind != POSES else theta0[:, :0]
        memory = np.zeros((len(betas), self._memory.stop))
        return np.concatenate([memory, betas, told], axis=1, dtype=np.float32)

    def step(self, state: State, theta: NDArray) -> tuple[State, Codes]:
        """One step of the network for all."""
        inputs = np.concatenate([state[:, self._betas], theta], axis=1, dtype=np.float32)
        kept = state[:, self._betas.start :]
        if self._kind != POSES:
            inputs, past = self._past.told(state, inputs, self._kind)
            kept = np.concatenate([state[:, self._betas], past], axis=1)
        found = self._run(motion=inputs, state=state[:, self._memory])
        return np.concatenate([found["next_state"], kept], axis=1), found["codes"]

    def reshaped(self, state: State, betas: NDArray) -> State:
        """The same past, of bodies betas (B, 10) from here on."""
        state = state.copy()
        state[:, self._betas] = betas
        return state

    def stopped(self, state: State) -> State:
        """Nothing is owed."""
        return state

    def offsets_m(self, betas: NDArray, codes: Codes, theta: NDArray) -> NDArray[np.float32]:
        """Decoded."""
        assert self._decoder is not None
        return self._decoder(latents=codes)["offsets"]


class _Past:
    """The two poses before, and how many have been, in a state's columns from `start` on: what a
    network that is told of changes needs."""

    def __init__(self, start: int) -> None:
        ends = start + THETA_SIZE, start + 2 * THETA_SIZE
        self._before, self._earlier = slice(start, ends[0]), slice(*ends)
        self._age = slice(ends[1], ends[1] + 1)

    def begun(self, theta0: NDArray) -> NDArray:
        return np.concatenate([theta0, theta0, np.zeros((len(theta0), 1))], axis=1)

    def told(self, state: State, joined: NDArray, kind: InputKind) -> tuple[NDArray, NDArray]:
        """Inputs (B, I) of betas and theta (B, 79), and what is past after them."""
        betas, theta = joined[:, :N_BETAS], joined[:, N_BETAS:]
        before, age = state[:, self._before], state[:, self._age]
        # Who makes her first move was moving like that before: no second difference.
        earlier = np.where(age == 1, 2 * before - theta, state[:, self._earlier])
        frames = [np.concatenate([betas, pose], axis=1) for pose in (earlier, before, theta)]
        past = np.concatenate([theta, before, np.minimum(age + 1, 2)], axis=1)
        return kind.of(np.stack(frames))[-1], past


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
