"""The streaming predictor as an engine of `dsnet verify`: one frame at a time."""

from __future__ import annotations

import numpy as np

from bridge.exchange.trained_dsnet import TrainedDsnet
from bridge.paper import N_BETAS
from bridge.runtime.streams import StreamingPredictor
from bridge.verify.protocol import Case, Tensors, serve


def dsnet_stream(case: Case) -> Tensors:
    """Latents of motions (B, T, 79), B characters side by side."""
    motion = case.inputs()["motion"]
    predictor = StreamingPredictor(TrainedDsnet.from_arrays("dsnet", case.weights()))
    frames = [
        predictor.step(frame[:, N_BETAS:], frame[:, :N_BETAS]) for frame in motion.swapaxes(0, 1)
    ]
    return {"layer/latents": np.stack(frames, axis=1)}


if __name__ == "__main__":
    serve({"dsnet_stream": dsnet_stream})
