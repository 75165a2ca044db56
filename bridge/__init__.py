"""The contract between the frameworks: NumPy arrays on disk, and what reads them."""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

from bridge.errors import DsnetError

if TYPE_CHECKING:
    from bridge.motion.resampling import load_motion
    from bridge.runs import read_artifact, write_artifact

# Read when ONNX Runtime is imported, which else reports to its maker and leaves files behind.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

__all__ = ["DsnetError", "__version__", "load_motion", "read_artifact", "write_artifact"]
__version__ = "0.2.0"

_LOADED_LATE = {
    "load_motion": "bridge.motion.resampling",
    "read_artifact": "bridge.runs",
    "write_artifact": "bridge.runs",
}


def __getattr__(name: str) -> Any:
    if name in _LOADED_LATE:
        return getattr(import_module(_LOADED_LATE[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
