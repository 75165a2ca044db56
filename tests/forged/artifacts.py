"""What a stage leaves, without the stage."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from bridge.motion import MotionSequence, to_manifest
from bridge.runs import Artifact, write_artifact


def put(
    path: Path,
    arrays: dict[str, NDArray],
    sequences: Iterable[MotionSequence] = (),
    **record: Any,
) -> Artifact:
    """Write synthetic arrays, in units that nobody reads, as the stage that `path` ends in."""
    if sequences:
        record["sequences"] = to_manifest(sequences)
    units = dict.fromkeys(arrays, "1")
    return write_artifact(path, path.name, arrays, units=units, data="synthetic", **record)
