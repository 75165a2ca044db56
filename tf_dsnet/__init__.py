"""DSNet, its training, the mesh autoencoder and SMPL in TensorFlow and Keras."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tf_dsnet.clip_batches import ClipBatches
    from tf_dsnet.mesh_autoencoder import KerasMeshAutoencoder
    from tf_dsnet.model import BlockLSTM, SumOfDistances, build_dsnet
    from tf_dsnet.smpl import KerasSMPL, unpose

    StreamingPredictor: Any  # from dsnet, which this package does not import

_LOADED_LATE = {
    "BlockLSTM": "tf_dsnet.model",
    "ClipBatches": "tf_dsnet.clip_batches",
    "KerasMeshAutoencoder": "tf_dsnet.mesh_autoencoder",
    "KerasSMPL": "tf_dsnet.smpl",
    "StreamingPredictor": "dsnet.stream.streaming_predictor",
    "SumOfDistances": "tf_dsnet.model",
    "build_dsnet": "tf_dsnet.model",
    "unpose": "tf_dsnet.smpl",
}
__all__ = [
    "BlockLSTM", "ClipBatches", "KerasMeshAutoencoder", "KerasSMPL", "StreamingPredictor",
    "SumOfDistances", "build_dsnet", "unpose",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    # Lazily, so that TensorFlow and ONNX Runtime are loaded only when they are needed.
    if name in _LOADED_LATE:
        return getattr(import_module(_LOADED_LATE[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
