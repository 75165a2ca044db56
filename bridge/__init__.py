"""The contract between the frameworks: NumPy arrays on disk, and what reads them."""

from bridge.errors import DsnetError

__all__ = ["DsnetError", "__version__"]
__version__ = "0.1.0"
