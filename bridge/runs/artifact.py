"""Artifacts: a folder of `.npy` arrays and files, described by `manifest.json`.

An artifact is written beside its final place and renamed into it, so that no
reader ever meets half of one. Arrays are memory-mapped and never unpickled.
The manifest says what each array is (shape, dtype, unit, SHA-256), what the
artifact was made from, and with which configuration; everything that differs
between two identical runs (time, machine, command) stands under `provenance`.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import resource
import shutil
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from bridge.errors import DsnetError

SCHEMA_VERSION = 1
MANIFEST = "manifest.json"
DataOrigin = Literal["synthetic", "licensed"]
_RECORDED_PACKAGES = ("numpy", "scipy", "torch", "tensorflow", "keras")
_RESERVED_KEYS = {"schema", "kind", "data", "arrays", "files", "upstream", "config", "provenance"}


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


def write_text_atomically(path: Path, text: str) -> None:
    """Write `text` beside `path` and rename it into place."""
    partial = path.with_name(f".{path.name}.partial")
    partial.write_text(text, encoding="utf-8")
    os.replace(partial, path)


@dataclass(frozen=True)
class Artifact:
    """One finished artifact on disk."""

    path: Path
    manifest: dict[str, Any] = field(repr=False)

    @property
    def origin(self) -> DataOrigin:
        """`synthetic` or `licensed`."""
        return self.manifest["data"]

    @property
    def content_sha256(self) -> str:
        """Digest of everything but `provenance`: equal content, equal digest."""
        content = {key: value for key, value in self.manifest.items() if key != "provenance"}
        return json_sha256(content)

    def array(self, name: str) -> NDArray[Any]:
        """Memory-map one array, read-only, checked against the manifest."""
        entry = self.manifest["arrays"].get(name)
        if entry is None:
            raise DsnetError(
                f"array {name!r} asked of {self.path}",
                f"one of {sorted(self.manifest['arrays'])}",
                "Run the stage that writes this artifact again.",
            )
        return _open_array(self.path / f"{name}.npy", entry)

    def file(self, name: str) -> Path:
        """Path of one of the artifact's files that are not arrays."""
        if name not in self.manifest["files"]:
            raise DsnetError(
                f"file {name!r} asked of {self.path}",
                f"one of {sorted(self.manifest['files'])}",
                "Run the stage that writes this artifact again.",
            )
        return self.path / name

    def verify(self) -> None:
        """Compare every array and file with the SHA-256 in the manifest."""
        entries = {f"{name}.npy": entry for name, entry in self.manifest["arrays"].items()}
        for name, entry in {**entries, **self.manifest["files"]}.items():
            found = file_sha256(self.path / name) if (self.path / name).is_file() else "no file"
            if found != entry["sha256"]:
                raise DsnetError(
                    f"{self.path / name} with SHA-256 {found}",
                    entry["sha256"],
                    "It changed after it was written: delete the folder and run its stage again.",
                )


def _open_array(path: Path, entry: Mapping[str, Any]) -> NDArray[Any]:
    try:
        # NumPy cannot map an array without elements.
        mode = "r" if np.prod(entry["shape"]) else None
        array = np.load(path, mmap_mode=mode, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise DsnetError(
            f"{path}, which does not load ({error})",
            f"a .npy array of shape {tuple(entry['shape'])}",
            "Delete the folder and run its stage again.",
        ) from error
    if list(array.shape) != entry["shape"] or str(array.dtype) != entry["dtype"]:
        raise DsnetError(
            f"{path} with shape {array.shape} and dtype {array.dtype}",
            f"shape {tuple(entry['shape'])} and dtype {entry['dtype']}",
            "Delete the folder and run its stage again.",
        )
    return array


def read_artifact(path: Path | str, kind: str | None = None) -> Artifact:
    """Open the artifact in folder `path`.

    Raises
    ------
    DsnetError
        If there is no manifest, it is not one of ours, or not of `kind`.
    """
    path = Path(path)
    try:
        manifest = json.loads((path / MANIFEST).read_text(encoding="utf-8"))
    except OSError as error:
        raise DsnetError(
            f"{path}, which has no {MANIFEST}",
            "the folder of a finished stage",
            "Run that stage first.",
        ) from error
    except ValueError as error:
        raise DsnetError(
            f"{path / MANIFEST}, which is not JSON ({error})",
            "a manifest written by dsnet",
            "Delete the folder and run its stage again.",
        ) from error
    missing = sorted(({"schema", "kind", "arrays", "files"}) - set(manifest))
    if missing or manifest["schema"] != SCHEMA_VERSION:
        raise DsnetError(
            f"{path / MANIFEST} of schema {manifest.get('schema')} lacking {missing or 'nothing'}",
            f"schema {SCHEMA_VERSION}",
            "Delete the folder and run its stage again with this version.",
        )
    if kind is not None and manifest["kind"] != kind:
        raise DsnetError(
            f"{path}, an artifact of kind {manifest['kind']!r}",
            f"kind {kind!r}",
            "Pass that stage's folder.",
        )
    return Artifact(path, manifest)


class ArtifactWriter:
    """Fills `.<name>.partial` beside `path`; `finish` renames it to `path`.

    The partial folder outlives a killed process: a stage that keeps its
    checkpoints under `checkpoints` finds them there when it is started again
    with the same `fingerprint`; with another one the folder is emptied.
    """

    def __init__(
        self, path: Path | str, kind: str, *, data: DataOrigin, fingerprint: str = ""
    ) -> None:
        self.path = Path(path)
        self._partial = self.path.with_name(f".{self.path.name}.partial")
        self._started = time.perf_counter()
        self._manifest: dict[str, Any] = {"schema": SCHEMA_VERSION, "kind": kind, "data": data}
        self._units: dict[str, str] = {}
        self._extra: dict[str, Any] = {}
        self._measured: dict[str, Any] = {}
        self._prepare(fingerprint)

    def _prepare(self, fingerprint: str) -> None:
        mark = self._partial / "checkpoints" / "fingerprint"
        resumable = fingerprint and mark.is_file() and mark.read_text() == fingerprint
        if self._partial.exists() and not resumable:
            shutil.rmtree(self._partial)
        mark.parent.mkdir(parents=True, exist_ok=True)
        mark.write_text(fingerprint)

    @property
    def checkpoints(self) -> Path:
        """Folder for checkpoints; it vanishes when the artifact is finished."""
        return self._partial / "checkpoints"

    def put(self, name: str, array: ArrayLike, unit: str) -> None:
        """Store a whole array as `<name>.npy`; `unit` goes to the manifest."""
        self._units[name] = unit
        np.save(self._partial / f"{name}.npy", np.ascontiguousarray(array), allow_pickle=False)

    def open_array(
        self, name: str, shape: tuple[int, ...], dtype: DTypeLike, unit: str
    ) -> NDArray[Any]:
        """Memory-map `<name>.npy` for writing in pieces; a resumed stage finds what it wrote."""
        self._units[name] = unit
        path = self._partial / f"{name}.npy"
        if path.exists():
            return np.lib.format.open_memmap(path, mode="r+")
        return np.lib.format.open_memmap(path, mode="w+", dtype=np.dtype(dtype), shape=shape)

    def file_path(self, name: str) -> Path:
        """Where to write a file that is not an array (weights, HDF5, PNG)."""
        path = self._partial / name
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def record(self, **extra: Any) -> None:
        """Add JSON values (a sequence index, results) to the manifest's top level."""
        if clash := _RESERVED_KEYS & set(extra):
            raise ValueError(f"manifest keys {sorted(clash)} are the writer's own")
        self._extra.update(extra)

    def record_measured(self, **values: Any) -> None:
        """Add values that differ from run to run (seconds, rates) to `provenance`."""
        self._measured.update(values)

    def finish(
        self, *, config: Mapping[str, Any] | None = None, upstream: Mapping[str, str] | None = None
    ) -> Artifact:
        """Hash everything, write the manifest, rename the folder into place."""
        shutil.rmtree(self.checkpoints, ignore_errors=True)
        manifest = {
            **self._manifest,
            **self._extra,
            "arrays": {name: self._describe(name) for name in sorted(self._units)},
            "files": self._describe_files(),
            "upstream": dict(upstream or {}),
            "config": dict(config or {}),
            "provenance": {
                **provenance(time.perf_counter() - self._started),
                **self._measured,
            },
        }
        write_text_atomically(self._partial / MANIFEST, json.dumps(manifest, indent=1) + "\n")
        _replace_folder(self._partial, self.path)
        return Artifact(self.path, manifest)

    def discard(self) -> None:
        """Forget everything written so far."""
        shutil.rmtree(self._partial, ignore_errors=True)

    def _describe(self, name: str) -> dict[str, Any]:
        path = self._partial / f"{name}.npy"
        # NumPy cannot map an array without elements; small ones need no mapping.
        mode = "r" if path.stat().st_size > 4096 else None
        array = np.load(path, mmap_mode=mode, allow_pickle=False)
        return {
            "shape": list(array.shape),
            "dtype": str(array.dtype),
            "unit": self._units[name],
            "sha256": file_sha256(path),
        }

    def _describe_files(self) -> dict[str, dict[str, Any]]:
        described = {MANIFEST, *(f"{name}.npy" for name in self._units)}
        found = sorted(path for path in self._partial.rglob("*") if path.is_file())
        files = {path.relative_to(self._partial).as_posix(): path for path in found}
        return {
            name: {"sha256": file_sha256(path), "bytes": path.stat().st_size}
            for name, path in files.items()
            if name not in described
        }


def _replace_folder(source: Path, target: Path) -> None:
    # A folder cannot be renamed over a full one, so the old one steps aside first.
    retired = target.with_name(f".{target.name}.retired")
    shutil.rmtree(retired, ignore_errors=True)
    if target.exists():
        target.rename(retired)
    source.rename(target)
    shutil.rmtree(retired, ignore_errors=True)


def provenance(wall_time_s: float) -> dict[str, Any]:
    """When, where, by which command and with which versions something was made."""
    versions = {"python": platform.python_version()}
    for package in _RECORDED_PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return {
        "command": [Path(sys.argv[0]).name, *sys.argv[1:]],
        "finished_utc": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "wall_time_s": round(wall_time_s, 3),
        "peak_memory_mb": _peak_memory_mb(),
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        "versions": versions,
    }


def _peak_memory_mb() -> int:
    """Largest resident memory so far of this process, or of one that it has started."""
    whose = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    largest = max(resource.getrusage(one).ru_maxrss for one in whose)
    return round(largest / (2**20 if sys.platform == "darwin" else 2**10))


def write_artifact(
    path: Path | str,
    kind: str,
    arrays: Mapping[str, ArrayLike],
    *,
    units: Mapping[str, str],
    data: DataOrigin,
    config: Mapping[str, Any] | None = None,
    upstream: Mapping[str, str] | None = None,
    **extra: Any,
) -> Artifact:
    """Write a small artifact in one call; see `ArtifactWriter` for large ones."""
    writer = ArtifactWriter(path, kind, data=data)
    for name, array in arrays.items():
        writer.put(name, array, units[name])
    writer.record(**extra)
    return writer.finish(config=config, upstream=upstream)
