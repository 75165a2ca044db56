"""Checkpoints: named arrays that a training goes on from, with their own digest.

A damaged one is none: what it held is made again, with the same result.
"""

from __future__ import annotations

from pathlib import Path

from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open

from bridge.exchange.weights import save_weights
from bridge.runs.damage import is_of_the_machine
from bridge.runs.digests import arrays_sha256
from bridge.runs.foreign_files import open_regular
from bridge.runs.processes import notify

_DIGEST = "sha256"


def save_checkpoint(path: Path, arrays: dict[str, NDArray]) -> None:
    """Write named arrays and their digest atomically."""
    save_weights(path, arrays, **{_DIGEST: arrays_sha256(arrays)})


def load_checkpoint(path: Path) -> dict[str, NDArray] | None:
    """The arrays as they were written; None if there are none, and, with a line, if damaged."""
    if not path.is_file():
        return None
    try:
        # Which says, where it cannot, why.
        with open_regular(path), safe_open(path, framework="numpy") as file:
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
            written = (file.metadata() or {}).get(_DIGEST)
    except (OSError, SafetensorError) as error:
        if is_of_the_machine(error):
            raise
        arrays, written = {}, None
    if written != arrays_sha256(arrays):
        notify(f"{path} is damaged; what it held is made again")
        return None
    return arrays
