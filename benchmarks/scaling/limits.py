"""What gives way when a corpus grows, and at how many sequences."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from benchmarks.scaling.model import DAY_S
from bridge.paper import N_VERTICES, THETA_SIZE
from bridge.runs.untrusted import MOST_JSON_BYTES

_OFFSETS_BYTES, _THETA_BYTES = 4 * 3 * N_VERTICES, 4 * THETA_SIZE
_LARGEST_FILE_BYTES = 2**44
"""Of ext4 with blocks of 4 kB."""
_DRIVER_BYTES = 64 * 10**9


def limits(facts: Mapping[str, Any], frames_each: float) -> list[dict[str, Any]]:
    """What breaks, the first first: at how many sequences, and what to do.

    Parameters
    ----------
    facts : `manifest_bytes` a sequence and `digest_mb_s`, as measured.
    frames_each : frames of a sequence.
    """
    offsets_each, theta_each = _OFFSETS_BYTES * frames_each, _THETA_BYTES * frames_each
    rows = [
        (
            f"a manifest lists its sequences: {MOST_JSON_BYTES / 2**20:.0f} MB are read at most",
            MOST_JSON_BYTES / facts["manifest_bytes"],
            "several runs",
        ),
        (
            "digests of one stage's offsets in one process take a day",
            DAY_S * 1e6 * facts["digest_mb_s"] / offsets_each,
            "several runs",
        ),
        (
            "a stage's offsets are one file: 16 TiB on ext4",
            _LARGEST_FILE_BYTES / offsets_each,
            "several runs, or a file system with larger files",
        ),
        (
            "`corpus` holds all poses, twice: 64 GB of memory",
            _DRIVER_BYTES / (2 * theta_each),
            "several runs",
        ),
    ]
    rows.sort(key=lambda row: row[1])
    return [{"what": what, "sequences": at, "remedy": remedy} for what, at, remedy in rows]
