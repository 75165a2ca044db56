"""Weights as named arrays in safetensors files: no code in them, readable by either framework."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file

from bridge.errors import DsnetError
from bridge.runs.damage import damage_refused
from bridge.runs.foreign_files import open_regular

_MOST_HEADER_BYTES = 1 << 20


def save_weights(path: Path | str, weights: Mapping[str, NDArray], **metadata: str) -> None:
    """Write named arrays atomically; `metadata` holds strings only."""
    path = Path(path)
    partial = path.with_name(f".{path.name}.partial")
    arrays = {name: np.require(array, requirements="C") for name, array in weights.items()}
    try:
        save_file(arrays, partial, metadata=metadata)
    except SafetensorError as error:
        raise _of_system(error, partial) from error
    os.replace(partial, path)


def load_weights(path: Path | str) -> dict[str, NDArray]:
    """Read named arrays.

    Raises
    ------
    DsnetError
        If the file is missing, truncated, of another format or of types that NumPy lacks.
    """

    def refusal(error: Exception) -> DsnetError:
        return DsnetError(
            f"{path}, which does not load ({str(error)[:200]})",
            "a safetensors file written by dsnet",
            "Train again, or copy the file again.",
        )

    with damage_refused(refusal, SafetensorError):
        with open_regular(path) as stream:
            header_bytes = int.from_bytes(stream.read(8), "little")
        if header_bytes > _MOST_HEADER_BYTES:
            raise ValueError(f"a header of {header_bytes} bytes")
        return _numeric(load_file(path))


def _of_system(error: SafetensorError, path: Path) -> Exception:
    """The system's own refusal, such as a full disk, of which the library gives the text."""
    if found := re.search(r"os error (\d+)", str(error)):
        number = int(found[1])
        return OSError(number, os.strerror(number), str(path))
    return error


def _numeric(weights: dict[str, NDArray]) -> dict[str, NDArray]:
    for name, array in weights.items():
        if array.dtype.kind not in "iufb" or not name.isprintable():
            raise ValueError(f"{name!r} of {array.dtype}")
    return weights


def refuse_nonfinite(weights: Mapping[str, NDArray], owner: str, remedy: str) -> None:
    """Check trained weights before they are kept.

    Raises
    ------
    DsnetError
        If an array holds NaN or infinity; `owner` says whose, `remedy` what to do.
    """
    for name, array in weights.items():
        if not np.isfinite(array).all():
            raise DsnetError(f"weights {name!r} of {owner} with NaN or inf", "numbers", remedy)
