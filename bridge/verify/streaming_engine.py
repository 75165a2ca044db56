"""The streaming predictor as an engine of `dsnet verify`: NumPy alone, one frame at a time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from bridge.exchange.trained_dsnet import Scaling, TrainedDsnet
from bridge.paper import N_BETAS
from bridge.runtime.streaming import StreamingPredictor
from bridge.verify.protocol import Case, Tensors, serve

_SCALING = "scaling/"


def dsnet_stream(case: Case) -> Tensors:
    """Latents of motions (B, T, 79), B characters side by side."""
    motion = case.inputs()["motion"]
    predictor = StreamingPredictor(_reading(case.weights()))
    frames = [
        predictor.step(frame[:, N_BETAS:], frame[:, :N_BETAS]) for frame in motion.swapaxes(0, 1)
    ]
    return {"layer/latents": np.stack(frames, axis=1)}


def _reading(arrays: Mapping[str, NDArray]) -> TrainedDsnet:
    """A reading from arrays in which `scaling/...` stand beside the weights, or do not."""
    weights = {name: array for name, array in arrays.items() if not name.startswith(_SCALING)}
    scaling = {name.removeprefix(_SCALING): arrays[name] for name in arrays.keys() - weights.keys()}
    if not scaling:
        return TrainedDsnet("faithful", weights, Scaling.identity())
    return TrainedDsnet("standardised", weights, Scaling(**scaling))


if __name__ == "__main__":
    serve({"dsnet_stream": dsnet_stream})
