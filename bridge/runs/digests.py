"""SHA-256 of files and JSON values; a file that has not changed is read once only.

Digests of files above 64 kB are kept in `.digests/` of the runs' folder, with each file's size,
times and inode. What is damaged, unwritable or out of date there costs a second reading, no more.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.runs.folders import runs_root

_SMALL_BYTES = 1 << 16
# A file system's clock ticks every few ms: what was changed just now may change again unseen.
_SETTLED_NS = 50_000_000
_Stamp = list[int]


def file_sha256(path: Path) -> str:
    """SHA-256 of a file's bytes, read in blocks."""
    with open(path, "rb") as stream:
        digest = hashlib.sha256()
        while block := stream.read(1 << 22):
            digest.update(block)
    return digest.hexdigest()


def json_sha256(value: Any) -> str:
    """SHA-256 of a JSON value in canonical form (sorted keys, no spaces)."""
    return hashlib.sha256(
        json.dumps(value, sort_keys=True, separators=(",", ":")).encode()
    ).hexdigest()


def arrays_sha256(arrays: Mapping[str, NDArray[Any]]) -> str:
    """SHA-256 of named arrays: names, shapes, types and values."""
    digest = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        digest.update(json.dumps([name, array.shape, array.dtype.str]).encode())
        digest.update(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)
    return digest.hexdigest()


def cached_sha256(path: Path) -> str:
    """SHA-256 of a file; from the cache if the file is the one that was read for it."""
    (digest,) = cached_sha256s([path])
    return digest


def cached_sha256s(paths: Iterable[Path]) -> list[str]:
    """`cached_sha256` of each; what had to be read is remembered at the end, all at once."""
    found: list[str] = []
    read: list[tuple[Path, str]] = []
    try:
        for path in paths:
            stamp = _stamp(path)
            known = _known(path) if stamp[0] > _SMALL_BYTES else None
            if known and known["stamp"] == stamp:
                found.append(known["sha256"])
                continue
            found.append(file_sha256(path))
            if stamp[0] > _SMALL_BYTES and _stamp(path) == stamp:
                read.append((path, found[-1]))
    finally:
        if read:
            remember(read)
    return found


def remember(digests: Iterable[tuple[Path, str]]) -> None:
    """Keep the digests of files that were just read; where that is impossible, do without."""
    by_cache: dict[Path, dict[str, Any]] = {}
    for path, digest in digests:
        key, cache = _place(path)
        stamp = _stamp(path)
        if stamp[0] > _SMALL_BYTES and time.time_ns() - max(stamp[1:3]) > _SETTLED_NS:
            by_cache.setdefault(cache, {})[key] = {"stamp": stamp, "sha256": digest}
    for cache, entries in by_cache.items():
        kept = {key: entry for key, entry in _load(cache).items() if Path(key).exists()}
        _save(cache, {**kept, **entries})


def _stamp(path: Path) -> _Stamp:
    found = path.stat()
    return [found.st_size, found.st_mtime_ns, found.st_ctime_ns, found.st_ino]


def _place(path: Path) -> tuple[str, Path]:
    """A file's key, and the cache that it is in: its run's, or the one of all other files."""
    root, path = runs_root().resolve(), path.resolve()
    run = path.relative_to(root).parts[0] if path.is_relative_to(root) else ".others"
    return str(path), root / ".digests" / f"{run}.json"


def _known(path: Path) -> dict[str, Any] | None:
    key, cache = _place(path)
    return _load(cache).get(key)


def _load(cache: Path) -> dict[str, Any]:
    """What a cache holds; as long as its file is the same it is read once."""
    try:
        return _read(cache, *_stamp(cache))
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return {}


@lru_cache(maxsize=4)
def _read(cache: Path, *_stamp_of_cache: int) -> dict[str, Any]:
    content = json.loads(cache.read_bytes())
    return content["files"] if content["sha256"] == json_sha256(content["files"]) else {}


def _save(cache: Path, files: dict[str, Any]) -> None:
    with suppress(OSError):
        # The folder of all runs is not made for the sake of a cache.
        cache.parent.mkdir(exist_ok=True)
        # Not renamed into place: half of one is none, and a kill leaves no other file.
        text = json.dumps({"files": files, "sha256": json_sha256(files)})
        cache.write_text(text, encoding="utf-8")
