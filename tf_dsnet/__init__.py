"""The TensorFlow half of dsnet: from latents and motions to predictions, and to vertices."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from bridge.runtime.streaming import StreamingPredictor

if TYPE_CHECKING:
    from tf_dsnet.codec import load_codec
    from tf_dsnet.mesh_autoencoder import KerasMeshAutoencoder
    from tf_dsnet.model import build_dsnet
    from tf_dsnet.smpl import KerasSMPL
    from tf_dsnet.unposing import unpose

__all__ = [
    "KerasMeshAutoencoder",
    "KerasSMPL",
    "StreamingPredictor",
    "build_dsnet",
    "load_codec",
    "unpose",
]
_NEED_TENSORFLOW = {
    "KerasSMPL": "smpl",
    "KerasMeshAutoencoder": "mesh_autoencoder",
    "build_dsnet": "model",
    "load_codec": "codec",
    "unpose": "unposing",
}


def __getattr__(name: str) -> Any:
    # Streaming needs NumPy alone, so TensorFlow is loaded only for what computes with it.
    if name in _NEED_TENSORFLOW:
        return getattr(import_module(f"tf_dsnet.{_NEED_TENSORFLOW[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
