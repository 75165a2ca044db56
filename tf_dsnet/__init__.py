"""DSNet, its training, the mesh autoencoder and SMPL in TensorFlow and Keras."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tf_dsnet.mesh_autoencoder import KerasMeshAutoencoder
    from tf_dsnet.model import build_dsnet
    from tf_dsnet.smpl import KerasSMPL, unpose

    StreamingPredictor: Any  # from dsnet, which this package does not import

__all__ = ["KerasMeshAutoencoder", "KerasSMPL", "StreamingPredictor", "build_dsnet", "unpose"]
_LOADED_LATE = {
    "KerasMeshAutoencoder": "tf_dsnet.mesh_autoencoder",
    "KerasSMPL": "tf_dsnet.smpl",
    "StreamingPredictor": "dsnet.stream.streaming_predictor",
    "build_dsnet": "tf_dsnet.model",
    "unpose": "tf_dsnet.smpl",
}


def __getattr__(name: str) -> Any:
    # Lazily, so that TensorFlow and ONNX Runtime are loaded only when they are needed.
    if name in _LOADED_LATE:
        return getattr(import_module(_LOADED_LATE[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
