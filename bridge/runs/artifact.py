"""Artifacts: a folder of `.npy` arrays and files, described by `manifest.json`.

Arrays are memory-mapped and never unpickled. The manifest says what each array is (shape, dtype,
unit, SHA-256), what the artifact was made from, and with which configuration; everything that
differs between two identical runs (time, machine, command) stands under `provenance`. All else has
one digest, the manifest's `sha256`. Nothing is read before its bytes are those of the manifest.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.runs.damage import damage_refused
from bridge.runs.digests import cached_sha256, cached_sha256s, file_sha256, json_sha256
from bridge.runs.folders import MANIFEST
from bridge.runs.foreign_files import read_json
from bridge.runs.manifests import flaw_of_manifest
from bridge.runs.storage import map_npy

SCHEMA_VERSION = 2
DataOrigin = Literal["synthetic", "licensed"]
WRITERS_KEYS = frozenset(
    {
        "schema",
        "kind",
        "data",
        "arrays",
        "files",
        "upstream",
        "config",
        "provenance",
        "sha256",
    }
)
"""What every manifest has; an artifact's own values stand beside them."""


def content_digest(manifest: Mapping[str, Any]) -> str:
    """Digest of everything in a manifest but `provenance`: equal content, equal digest."""
    apart = ("provenance", "sha256")
    return json_sha256({key: value for key, value in manifest.items() if key not in apart})


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
        """Digest of all arrays, files and values: equal content, equal digest."""
        return self.manifest["sha256"]

    @property
    def digests(self) -> dict[str, str]:
        """SHA-256 of every file of the artifact but its manifest, by path in its folder."""
        arrays = {f"{name}.npy": entry for name, entry in self.manifest["arrays"].items()}
        described = {**arrays, **self.manifest["files"]}
        return {name: entry["sha256"] for name, entry in described.items()}

    def array(self, name: str) -> NDArray[Any]:
        """Memory-map one array, read-only.

        Raises
        ------
        DsnetError
            If there is no such array, or it is not the one that was written.
        """
        entry = self._entry("arrays", name)
        path = self._unchanged(f"{name}.npy", entry)
        shape, dtype = tuple(entry["shape"]), np.dtype(entry["dtype"])

        def refusal(error: Exception) -> DsnetError:
            return DsnetError(
                f"{path}, which does not hold what {MANIFEST} says ({str(error)[:200]})",
                f"{dtype} of shape {shape}",
                "Delete the folder and run its stage again.",
            )

        with damage_refused(refusal):
            array = map_npy(path)
            if (array.shape, array.dtype) != (shape, dtype):
                raise ValueError(f"{array.dtype} of shape {array.shape}")
        return array

    def file(self, name: str) -> Path:
        """Path of one of the artifact's files that are not arrays.

        Raises
        ------
        DsnetError
            If there is no such file, or it is not the one that was written.
        """
        return self.files([name])[0]

    def files(self, names: Iterable[str]) -> list[Path]:
        """`file` of each."""
        entries = [(self.path / name, self._entry("files", name)) for name in names]
        there = [path for path, _ in entries if path.is_file()]
        found = dict(zip(there, cached_sha256s(there), strict=True))
        for path, entry in entries:
            _compare(path, found.get(path, "no file"), entry["sha256"])
        return [path for path, _ in entries]

    def verify(self) -> None:
        """Read every array and file again and compare it with its SHA-256.

        Raises
        ------
        DsnetError
            If one changed, or if there is a file that the manifest does not know.
        """
        for name, expected in self.digests.items():
            path = self.path / name
            _compare(path, file_sha256(path) if path.is_file() else "no file", expected)
        found = (path for path in self.path.rglob("*") if not path.is_dir())
        names = {path.relative_to(self.path).as_posix() for path in found}
        if foreign := sorted(names - {MANIFEST, *self.digests}):
            raise DsnetError(
                f"{self.path / foreign[0]}, which is not part of the artifact",
                f"only what {MANIFEST} names",
                "Move the file elsewhere.",
            )

    def _entry(self, group: Literal["arrays", "files"], name: str) -> dict[str, Any]:
        entry = self.manifest[group].get(name)
        if entry is None:
            raise DsnetError(
                f"{group[:-1]} {name!r} asked of {self.path}",
                f"one of {sorted(self.manifest[group])}",
                "Run the stage that writes this artifact again.",
            )
        return entry

    def _unchanged(self, name: str, entry: Mapping[str, Any]) -> Path:
        path = self.path / name
        found = cached_sha256(path) if path.is_file() else "no file"
        _compare(path, found, entry["sha256"])
        return path


class _Manifest(dict[str, Any]):
    """A manifest's values; a stage that asks for one of its own that is missing is told."""

    def __init__(self, path: Path, values: Mapping[str, Any]) -> None:
        super().__init__(values)
        self._path = path

    def __missing__(self, key: str) -> Any:
        raise DsnetError(
            f"{self._path} without {key!r}",
            f"what the stage writes into its {MANIFEST}",
            "Delete the folder and run its stage again.",
        )


def _compare(path: Path, found: str, expected: str) -> None:
    if found != expected:
        raise DsnetError(
            f"{path} with SHA-256 {found}",
            expected,
            "It changed after it was written: delete the folder and run its stage again.",
        )


def read_artifact(path: Path | str, kind: str | None = None) -> Artifact:
    """Open the artifact in folder `path`.

    Raises
    ------
    DsnetError
        If there is no manifest, it is not as it was written, or not of `kind`.
    """
    path = Path(path)
    manifest = _read_manifest(path / MANIFEST)
    if kind is not None and manifest["kind"] != kind:
        raise DsnetError(
            f"{path}, an artifact of kind {manifest['kind']!r}",
            f"kind {kind!r}",
            "Pass that stage's folder.",
        )
    return Artifact(path, manifest)


def _read_manifest(path: Path) -> dict[str, Any]:
    with damage_refused(partial(_unreadable_manifest, path)):
        manifest = read_json(path)
    manifest = manifest if isinstance(manifest, dict) else {}
    missing = sorted(WRITERS_KEYS - set(manifest))
    if missing or manifest["schema"] != SCHEMA_VERSION:
        raise DsnetError(
            f"{path} of schema {str(manifest.get('schema'))[:40]} lacking {missing or 'nothing'}",
            f"schema {SCHEMA_VERSION}",
            "Delete the folder and run its stage again with this version.",
        )
    if flaw := flaw_of_manifest(manifest):
        raise DsnetError(
            f"{path}, {flaw}",
            "a manifest written by dsnet",
            "Delete the folder and run its stage again.",
        )
    _compare(path, content_digest(manifest), manifest["sha256"])
    made = dict(manifest["provenance"])
    # Older manifests have none; it is no part of the content, but reports print what it covers.
    if (written := made.pop("sha256", None)) is not None:
        _compare(path, json_sha256(made), written)
    return _Manifest(path, manifest)


def _unreadable_manifest(path: Path, error: Exception) -> DsnetError:
    if isinstance(error, OSError):
        return DsnetError(
            f"{path.parent}, which has no {MANIFEST}",
            "the folder of a finished stage",
            "Run that stage first.",
        )
    return DsnetError(
        f"{path}, which is not JSON ({str(error)[:200]})",
        "a manifest written by dsnet",
        "Delete the folder and run its stage again.",
    )
