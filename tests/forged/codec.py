"""An autoencoder that nobody trained."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body import load_body_model
from bridge.exchange import save_weights
from bridge.exchange.dsnet import Scaling, TrainedDsnet
from bridge.runs import Artifact, ArtifactWriter
from dsnet.prediction.models import DsnetModel
from dsnet.verify import draws


def write_codec(
    folder: Path, arrays: Mapping[str, NDArray], architecture: Mapping[str, Any]
) -> Artifact:
    """The `train-ae` of these weights, named as by PyTorch, and of their normaliser's."""
    writer = ArtifactWriter(folder, "train-ae", data="synthetic")
    save_weights(writer.file_path("autoencoder.safetensors"), arrays)
    writer.record(architecture=dict(architecture))
    return writer.finish()


def papers_model(folder: Path) -> DsnetModel:
    """The paper's DSNet, with a decoder of few numbers, that nobody trained."""
    widths = (6890, 12, 8, 6, 4)
    decoder = draws.autoencoder_weights(1, widths)
    decoder["normaliser.mean_m"] = np.zeros((widths[0], 3), np.float32)
    decoder["normaliser.scale_m"] = np.full((widths[0], 3), 1e-3, np.float32)
    network = TrainedDsnet("dsnet_faithful", draws.dsnet_weights(2), Scaling.identity())
    codec = write_codec(folder, decoder, {"widths": widths})
    return DsnetModel(network, codec, load_body_model("embedded:female"))
