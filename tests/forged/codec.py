"""An autoencoder that nobody trained."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from bridge.exchange import save_weights
from bridge.runs import Artifact, ArtifactWriter


def write_codec(
    folder: Path, arrays: Mapping[str, NDArray], architecture: Mapping[str, Any]
) -> Artifact:
    """The `train-ae` of these weights, named as by PyTorch, and of their normaliser's."""
    writer = ArtifactWriter(folder, "train-ae", data="synthetic")
    save_weights(writer.file_path("autoencoder.safetensors"), arrays)
    writer.record(architecture=dict(architecture))
    return writer.finish()
