"""The TensorFlow half of dsnet: from latents and motions to predictions."""

from typing import TYPE_CHECKING, Any

from tf_dsnet.stream import StreamingPredictor

if TYPE_CHECKING:
    from tf_dsnet.model import build_dsnet

__all__ = ["StreamingPredictor", "build_dsnet"]


def __getattr__(name: str) -> Any:
    # Streaming needs NumPy alone, so TensorFlow is loaded only for the network itself.
    if name == "build_dsnet":
        from tf_dsnet.model import build_dsnet

        return build_dsnet
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
