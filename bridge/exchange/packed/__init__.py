"""An artifact's arrays in one small file: vertices within a stated error, all else as it was."""

from bridge.exchange.packed.reader import PackedFile, open_packed
from bridge.exchange.packed.writer import write_packed

__all__ = ["PackedFile", "open_packed", "write_packed"]
