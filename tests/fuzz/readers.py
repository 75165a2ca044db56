"""Every reader of files that come from strangers, and strategies of such files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from hypothesis import strategies as st

from tests.fuzz.mutations import Files


@dataclass(frozen=True)
class Reader:
    """What is read, and damaged files for it."""

    module: str
    """Of this folder; imported when it is needed: some need a framework."""
    read_name: str = "read"
    files_name: str = "files"

    def read(self) -> Callable[[Path], object]:
        """Reads a folder that holds the files."""
        return getattr(import_module(f"tests.fuzz.{self.module}"), self.read_name)

    def files(self) -> st.SearchStrategy[Files]:
        """Damaged files by name."""
        return getattr(import_module(f"tests.fuzz.{self.module}"), self.files_name)()


READERS = {
    "smpl_npz": Reader("bodies", files_name="npz_files"),
    "smpl_pickle": Reader("bodies", files_name="pickle_files"),
    "amass": Reader("motions"),
    "bvh": Reader("motions", files_name="bvh_files"),
    "dmpl": Reader("motions", "read_dmpl", "dmpl_files"),
    "dyna": Reader("meshes"),
    "artifact": Reader("artifacts"),
    "weights": Reader("networks", "read_weights", "weights_files"),
    "names": Reader("words"),
}
