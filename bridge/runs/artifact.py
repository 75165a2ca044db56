"""Artifacts: a folder of `.npy` arrays and files, described by `manifest.json`.

Arrays are memory-mapped and never unpickled. The manifest says what each array is (shape, dtype,
unit, SHA-256), what the artifact was made from, and with which configuration; everything that
differs between two identical runs (time, machine, command) stands under `provenance`. All else has
one digest, the manifest's `sha256`. Nothing is read before its bytes are those of the manifest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.runs.files import MANIFEST, file_sha256, json_sha256, sha256_of, stamp_of
from bridge.runs.untrusted import damage_refused, is_plain_name, map_npy, read_json

SCHEMA_VERSION = 2
DataOrigin = Literal["synthetic", "licensed"]
DataShown = Literal["synthetic", "synthetic flesh", "licensed"]
"""Flesh may be computed where the body that it is on is not."""
WRITERS_KEYS: dict[str, type] = {
    "schema": int,
    **dict.fromkeys(("kind", "data", "sha256"), str),
    **dict.fromkeys(("arrays", "files", "upstream", "config", "provenance"), dict),
}
"""What every manifest has; an artifact's own values stand beside them."""
_MADE_AGAIN = "Delete the folder and run its stage again."


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
        return self.manifest["data"]

    @property
    def content_sha256(self) -> str:
        return self.manifest["sha256"]

    @property
    def digests(self) -> dict[str, str]:
        """SHA-256 of every file of the artifact but its manifest, by path in its folder."""
        arrays = {f"{name}.npy": entry for name, entry in self.manifest["arrays"].items()}
        described = {**arrays, **self.manifest["files"]}
        return {name: entry["sha256"] for name, entry in described.items()}

    def array(self, name: str) -> NDArray[Any]:
        """Memory-map one array, read-only."""
        entry = self.manifest["arrays"][name]
        path = self._unchanged(f"{name}.npy", entry["sha256"])
        shape, dtype = tuple(entry["shape"]), np.dtype(entry["dtype"])

        def refusal(error: Exception) -> DsnetError:
            received = f"{path}, which does not hold what {MANIFEST} says ({str(error)[:200]})"
            return DsnetError(received, f"{dtype} of shape {shape}", _MADE_AGAIN)

        with damage_refused(refusal):
            array = map_npy(path)
            if (array.shape, array.dtype) != (shape, dtype):
                raise ValueError(f"{array.dtype} of shape {array.shape}")
        return array

    def file(self, name: str) -> Path:
        """Path of one of the artifact's files that are not arrays."""
        return self._unchanged(name, self.manifest["files"][name]["sha256"])

    def present_sha256(self, path: Path, name: str, recorded: str) -> str:
        """Digest of a file as it is now: the recorded one, unread, if it has the stamp of then.

        `name` is what provenance calls it: a file of the artifact, or the place of an input.
        """
        stamp = stamp_of(path)
        known = stamp and stamp == self.manifest["provenance"].get("stamps", {}).get(name)
        return recorded if known else sha256_of(path)

    def verify(self) -> None:
        """Read all again; refuse what is not as written, and files that the manifest lacks."""
        for name, expected in self.digests.items():
            path = self.path / name
            _compare(path, file_sha256(path) if path.is_file() else "no file", expected)
        paths = (path for path in self.path.rglob("*") if not path.is_dir())
        names = {path.relative_to(self.path).as_posix() for path in paths}
        if foreign := sorted(names - {MANIFEST, *self.digests}):
            raise DsnetError(
                f"{self.path / foreign[0]}, which is not part of the artifact",
                f"only what {MANIFEST} names",
                "Move the file elsewhere.",
            )

    def _unchanged(self, name: str, digest: str) -> Path:
        path = self.path / name
        present = self.present_sha256(path, name, digest) if path.is_file() else "no file"
        _compare(path, present, digest)
        return path


class _Entries(dict[str, Any]):
    """Values in a manifest; a missing one is a DsnetError."""

    def __init__(self, path: Path, values: Mapping[str, Any]) -> None:
        super().__init__(values)
        self._path = path

    def __missing__(self, key: str) -> Any:
        raise DsnetError(f"{self._path} without {key!r}", f"one of {sorted(self)}", _MADE_AGAIN)


def _compare(path: Path, present: str, expected: str) -> None:
    if present != expected:
        raise DsnetError(
            f"{path} with SHA-256 {present}",
            expected,
            "It changed after it was written: delete the folder and run its stage again.",
        )


def read_artifact(path: Path | str, kind: str | None = None) -> Artifact:
    """Open the artifact in folder `path`; DsnetError where its manifest is missing, not as it was
    written, or not of `kind`.
    """
    path = Path(path)
    file = path / MANIFEST
    manifest = _read_manifest(file)
    if kind is not None and manifest["kind"] != kind:
        received = f"{path}, an artifact of kind {manifest['kind']!r}"
        raise DsnetError(received, f"kind {kind!r}", "Pass that stage's folder.")
    for group in ("arrays", "files"):
        manifest[group] = _Entries(file, manifest[group])
    return Artifact(path, _Entries(file, manifest))


def _read_manifest(path: Path) -> dict[str, Any]:
    def unreadable(error: Exception) -> DsnetError:
        if isinstance(error, OSError):
            having = f"{path.parent}, which has no {MANIFEST}"
            return DsnetError(having, "the folder of a finished stage", "Run that stage first.")
        received = f"{path}, which is not JSON ({str(error)[:200]})"
        return DsnetError(received, "a manifest written by dsnet", _MADE_AGAIN)

    with damage_refused(unreadable):
        manifest = read_json(path)
    manifest = manifest if isinstance(manifest, dict) else {}
    if manifest.get("schema") != SCHEMA_VERSION:
        received = f"{path} of schema {str(manifest.get('schema'))[:40]}"
        remedy = "Delete the folder and run its stage again with this version."
        raise DsnetError(received, f"schema {SCHEMA_VERSION}", remedy)
    if key := _forged_key(manifest):
        received = f"{path}, whose {key!r} no stage wrote"
        raise DsnetError(received, "a manifest written by dsnet", _MADE_AGAIN)
    _compare(path, content_digest(manifest), manifest["sha256"])
    # Provenance is no part of the content, but reports print it: it has a digest of its own.
    made = dict(manifest["provenance"])
    written = made.pop("sha256")
    _compare(path, json_sha256(made), written)
    return manifest


def _forged_key(manifest: Mapping[str, Any]) -> str | None:
    """A key of a manifest whose value no stage wrote, None where there is none.

    The manifest's digest can be anybody's, and readers rely on this: names stay in the folder,
    arrays are of numbers, digests are text, sequences are objects.
    """
    for key, wanted in WRITERS_KEYS.items():
        if not isinstance(manifest.get(key), wanted):
            return key
    made, upstream = manifest["provenance"], manifest["upstream"]
    arrays, files = manifest["arrays"], manifest["files"]
    sequences, predictors = manifest.get("sequences", []), manifest.get("predictors", {})
    sound = {
        "data": manifest["data"] in ("synthetic", "licensed"),
        "provenance": isinstance(made.get("sha256"), str)
        and isinstance(made.get("stamps", {}), dict)
        and _are_texts(made.get("inputs", {})),
        "upstream": all(map(is_plain_name, upstream)) and _are_texts(upstream),
        "files": all(map(is_plain_name, files)) and all(map(_has_digest, files.values())),
        "arrays": all(map(is_plain_name, arrays)) and all(map(_is_array, arrays.values())),
        "sequences": isinstance(sequences, list) and all(isinstance(s, dict) for s in sequences),
        "predictors": isinstance(predictors, dict) and all(map(is_plain_name, predictors)),
    }
    return next((key for key, holds in sound.items() if not holds), None)


def _are_texts(value: Any) -> bool:
    return isinstance(value, dict) and all(isinstance(text, str) for text in value.values())


def _has_digest(entry: Any) -> bool:
    return isinstance(entry, dict) and isinstance(entry.get("sha256"), str)


def _is_array(entry: Any) -> bool:
    if not _has_digest(entry):
        return False
    shape, dtype = entry.get("shape"), entry.get("dtype")
    if not isinstance(shape, list) or not all(isinstance(n, int) and n >= 0 for n in shape):
        return False
    try:
        return isinstance(dtype, str) and np.dtype(dtype).kind in "biuf"
    except TypeError:
        return False
