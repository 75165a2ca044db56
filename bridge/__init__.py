"""The contract between the frameworks: NumPy arrays on disk, and what reads them."""

import os

from bridge.errors import DsnetError

# Read when ONNX Runtime is imported, which else reports to its maker and leaves files behind.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

__all__ = ["DsnetError", "__version__"]
__version__ = "0.1.0"
