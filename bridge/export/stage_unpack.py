"""`dsnet unpack`: a packed file as a folder of arrays again."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bridge.errors import DsnetError
from bridge.exchange.packed import PackedFile, open_packed
from bridge.runs import ArtifactWriter
from bridge.runs.digests import file_sha256
from bridge.runtime.out_folder import open_out_folder

KIND = "unpacked"


@dataclass(frozen=True, kw_only=True)
class UnpackConfig:
    """Write the arrays of a packed file as `.npy` files with a manifest that says where they are
    from and how exact they are."""

    file: Path | None = None
    """What `dsnet pack` wrote."""
    out: Path | None = None
    """Folder to write: a new or empty one, or one of an earlier call."""


PROFILES = {name: UnpackConfig() for name in ("smoke", "demo", "paper")}


def main(config: UnpackConfig) -> None:
    """Write the folder.

    Raises
    ------
    DsnetError
        If an option is missing, the file is none of these or damaged, or `out` cannot be written.
    """
    file, out = config.file, config.out
    if file is None or out is None:
        missing = "--file" if file is None else "--out"
        raise DsnetError(f"unpack without {missing}", f"{missing} PATH", f"Pass {missing} PATH.")
    with open_packed(file) as packed, open_out_folder(out, packed.origin, KIND) as writer:
        unpack(packed, writer)
        writer.finish(upstream={"packed": file_sha256(file)})


def unpack(packed: PackedFile, writer: ArtifactWriter) -> None:
    """Fill an artifact, block by block."""
    for name, entry in packed.bounded.items():
        array = writer.open_array(name, entry.shape, np.float32, entry.unit)
        for start, frames in packed.blocks(name):
            array[start : start + len(frames)] = frames
    for name, unit in packed.exact.items():
        writer.put(name, packed.array(name), unit)
    bounds_m = {name: entry.bound for name, entry in packed.bounded.items()}
    told = {key: packed.facts.get(key) for key in ("kind", "source_sha256", "manifest")}
    writer.record(bounds_m=bounds_m, packed=told)
