"""DSNet and the mesh autoencoder's decoder, applied to whole motions without a framework."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.exchange import load_weights
from bridge.exchange.clips import join_inputs
from bridge.exchange.trained_dsnet import TrainedDsnet, load_trained_dsnet
from bridge.runs import Artifact
from bridge.runtime.graphs.onnx_builder import GraphSession
from bridge.runtime.graphs.onnx_graphs import decoder_graph
from bridge.runtime.motion_predictor import FRAMES_AT_ONCE, MotionRoad, Prediction
from bridge.runtime.streams.streaming import SteppedDsnet


class DsnetMotionPredictor:
    """A trained DSNet, and the decoder of its latents."""

    def __init__(self, network: TrainedDsnet, decode: GraphSession) -> None:
        self._network, self._decode = network, decode

    def __call__(self, theta: NDArray, betas: NDArray) -> Prediction:
        """Offsets, and the latents (T, 100) that they are decoded from."""
        inputs = join_inputs(theta, betas).astype(np.float32)
        network = SteppedDsnet(self._network)
        latents = np.concatenate([network.step(frame[None]) for frame in inputs])
        return Prediction(self._decoded(latents), latents)

    def _decoded(self, latents: NDArray[np.float32]) -> Iterator[NDArray[np.float32]]:
        for start in range(0, len(latents), FRAMES_AT_ONCE):
            yield self._decode(latents=latents[start : start + FRAMES_AT_ONCE])["offsets"]


def load_decoder(codec: Artifact) -> GraphSession:
    """The decoder of a finished `train-ae`: `latents` (B, 100) to `offsets` (B, V, 3), metres."""
    arrays = load_weights(codec.file("autoencoder.safetensors"))
    weights = {name.removeprefix("model."): array for name, array in arrays.items()}
    return GraphSession(decoder_graph(weights, codec.manifest["architecture"]))


def _open(artifacts: Mapping[str, Artifact], name: str, _: BodyModelData) -> DsnetMotionPredictor:
    network = load_trained_dsnet(artifacts["train"], name)
    return DsnetMotionPredictor(network, load_decoder(artifacts["train-ae"]))


DSNET = MotionRoad(("train", "train-ae"), "train", _open)
"""The paper's: latents by DSNet, offsets by the autoencoder's decoder."""
