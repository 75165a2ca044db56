"""Artifacts: a folder of `.npy` arrays and files, described by `manifest.json`.

Arrays are memory-mapped and never unpickled. The manifest says what each array is (shape, dtype,
unit, SHA-256), what the artifact was made from, and with which configuration; everything that
differs between two identical runs (time, machine, command) stands under `provenance`. All else has
one digest, the manifest's `sha256`. Nothing is read before its bytes are those of the manifest.
"""

from __future__ import annotations

import json
import os
import platform
import shutil
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from bridge.errors import DsnetError
from bridge.installation import version_of
from bridge.runs.files import (
    CHECKPOINTS,
    MANIFEST,
    ArrayFile,
    file_sha256,
    json_sha256,
    map_array,
    partial_folder,
    save_array,
    settle,
    sha256_of,
    stamp_of,
    write_text_atomically,
)
from bridge.runs.untrusted import damage_refused, is_plain_name, map_npy, read_json

try:
    import resource
except ModuleNotFoundError:  # Windows
    resource = None

SCHEMA_VERSION = 2
DataOrigin = Literal["synthetic", "licensed"]
_WRITERS_KEYS: dict[str, type] = {
    "schema": int,
    **dict.fromkeys(("kind", "data", "sha256"), str),
    **dict.fromkeys(("arrays", "files", "upstream", "config", "provenance"), dict),
}
"""What every manifest has; an artifact's own values stand beside them."""
_RECORDED_PACKAGES = ("numpy", "scipy", "torch", "tensorflow", "keras")
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
        entry = self._entry("arrays", name)
        path = self._unchanged(f"{name}.npy", entry["sha256"])
        shape, dtype = tuple(entry["shape"]), np.dtype(entry["dtype"])

        def refusal(error: Exception) -> DsnetError:
            said = f"{path}, which does not hold what {MANIFEST} says ({str(error)[:200]})"
            return DsnetError(said, f"{dtype} of shape {shape}", _MADE_AGAIN)

        with damage_refused(refusal):
            array = map_npy(path)
            if (array.shape, array.dtype) != (shape, dtype):
                raise ValueError(f"{array.dtype} of shape {array.shape}")
        return array

    def file(self, name: str) -> Path:
        """Path of one of the artifact's files that are not arrays."""
        return self._unchanged(name, self._entry("files", name)["sha256"])

    def verify(self) -> None:
        """Read all again; refuse what is not as written, and files that the manifest lacks."""
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

    def _unchanged(self, name: str, digest: str) -> Path:
        """A file with that digest; what has the stamp that it was written with is not read."""
        path = self.path / name
        if not path.is_file():
            _compare(path, "no file", digest)
        stamp = stamp_of(path)
        if stamp is None or stamp != self.manifest["provenance"].get("stamps", {}).get(name):
            _compare(path, sha256_of(path), digest)
        return path


class _Manifest(dict[str, Any]):
    """A manifest's values; a stage that asks for one of its own that is missing is told."""

    def __init__(self, path: Path, values: Mapping[str, Any]) -> None:
        super().__init__(values)
        self._path = path

    def __missing__(self, key: str) -> Any:
        expected = f"what the stage writes into its {MANIFEST}"
        raise DsnetError(f"{self._path} without {key!r}", expected, _MADE_AGAIN)


def _compare(path: Path, found: str, expected: str) -> None:
    if found != expected:
        raise DsnetError(
            f"{path} with SHA-256 {found}",
            expected,
            "It changed after it was written: delete the folder and run its stage again.",
        )


def read_artifact(path: Path | str, kind: str | None = None) -> Artifact:
    """Open the artifact in folder `path`; DsnetError where its manifest is missing, not as it was
    written, or not of `kind`.
    """
    path = Path(path)
    manifest = _read_manifest(path / MANIFEST)
    if kind is not None and manifest["kind"] != kind:
        received = f"{path}, an artifact of kind {manifest['kind']!r}"
        raise DsnetError(received, f"kind {kind!r}", "Pass that stage's folder.")
    return Artifact(path, manifest)


def _read_manifest(path: Path) -> dict[str, Any]:
    def unreadable(error: Exception) -> DsnetError:
        if isinstance(error, OSError):
            return DsnetError(
                f"{path.parent}, which has no {MANIFEST}",
                "the folder of a finished stage",
                "Run that stage first.",
            )
        received = f"{path}, which is not JSON ({str(error)[:200]})"
        return DsnetError(received, "a manifest written by dsnet", _MADE_AGAIN)

    with damage_refused(unreadable):
        manifest = read_json(path)
    manifest = manifest if isinstance(manifest, dict) else {}
    missing = sorted(_WRITERS_KEYS.keys() - manifest.keys())
    if missing or manifest["schema"] != SCHEMA_VERSION:
        raise DsnetError(
            f"{path} of schema {str(manifest.get('schema'))[:40]} lacking {missing or 'nothing'}",
            f"schema {SCHEMA_VERSION}",
            "Delete the folder and run its stage again with this version.",
        )
    if key := _forged_key(manifest):
        received = f"{path}, whose {key!r} no stage wrote"
        raise DsnetError(received, "a manifest written by dsnet", _MADE_AGAIN)
    _compare(path, content_digest(manifest), manifest["sha256"])
    made = dict(manifest["provenance"])
    # Older manifests have none; it is no part of the content, but reports print what it covers.
    if (written := made.pop("sha256", None)) is not None:
        _compare(path, json_sha256(made), written)
    return _Manifest(path, manifest)


def _forged_key(manifest: Mapping[str, Any]) -> str | None:
    """A key of a manifest whose value no stage wrote, None where there is none.

    The manifest's digest can be anybody's, and readers rely on this: names stay in the folder,
    arrays are of numbers, digests are text, sequences are objects.
    """
    for key, wanted in _WRITERS_KEYS.items():
        if not isinstance(manifest[key], wanted):
            return key
    made, upstream = manifest["provenance"], manifest["upstream"]
    arrays, files = manifest["arrays"], manifest["files"]
    sequences, predictors = manifest.get("sequences", []), manifest.get("predictors", {})
    sound = {
        "data": manifest["data"] in ("synthetic", "licensed"),
        "provenance": isinstance(made.get("sha256", ""), str)
        and isinstance(made.get("stamps", {}), dict)
        and isinstance(made.get("input_stamps", {}), dict)
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


class ArtifactWriter:
    """Fills `.<name>.partial` beside `path`; `finish` renames it to `path`.

    The partial folder outlives a killed process: a stage that keeps its checkpoints under
    `checkpoints` finds them there when it is started again with the same `fingerprint`; with
    another one the folder is emptied. The artifact holds what was declared (`put`, `open_array`,
    `file_path`) and nothing else.
    """

    def __init__(
        self, path: Path | str, kind: str, *, data: DataOrigin, fingerprint: str = ""
    ) -> None:
        self.path = Path(path)
        self._partial = partial_folder(self.path)
        self.checkpoints = self._partial / CHECKPOINTS
        """Folder for checkpoints; it vanishes when the artifact is finished."""
        self._mark = self.checkpoints / "fingerprint"
        self._manifest: dict[str, Any] = {"schema": SCHEMA_VERSION, "kind": kind, "data": data}
        self._units: dict[str, str] = {}
        self._files: set[str] = set()
        self._extra: dict[str, Any] = {}
        self._measured: dict[str, Any] = {}
        settle(self.path)
        mark = fingerprint.encode()
        if not (mark and self._mark.is_file() and self._mark.read_bytes() == mark):
            self.discard()
            self.checkpoints.mkdir(parents=True)
            write_text_atomically(self._mark, fingerprint)
        # As if this turn had begun so much earlier.
        self._started = time.perf_counter() - self._earlier_turns_s()

    def _earlier_turns_s(self) -> float:
        """Seconds of the turns before, which were killed: each counts to the last file it wrote."""
        kept, before_s = self.checkpoints / "turns", 0.0
        try:
            earlier_s, began = map(float, kept.read_text(encoding="utf-8").split())
            written = [path.stat().st_mtime for path in self._partial.rglob("*") if path != kept]
            before_s = max(0.0, earlier_s) + max(0.0, max(written) - began)
        except (OSError, ValueError):  # none, or a damaged one: no reason to stop work
            pass
        write_text_atomically(kept, f"{before_s} {time.time()}")
        return before_s

    def put(self, name: str, array: ArrayLike, unit: str) -> None:
        """Store a whole array as `<name>.npy`; `unit` goes to the manifest."""
        self._units[name] = unit
        save_array(self._partial / f"{name}.npy", array)

    def open_array(
        self, name: str, shape: tuple[int, ...], dtype: DTypeLike, unit: str
    ) -> NDArray[Any]:
        """Memory-map `<name>.npy` for writing in pieces; a resumed stage finds what it wrote."""
        self._units[name] = unit
        return map_array(self._partial / f"{name}.npy", shape, dtype)

    def array_file(
        self, name: str, shape: tuple[int, ...], dtype: DTypeLike, unit: str
    ) -> ArrayFile:
        """As `open_array`, for workers that write their own pieces."""
        array = self.open_array(name, shape, dtype, unit)
        # Without an element there is no map, and nothing will be written.
        header_bytes = getattr(array, "offset", 0)
        path = (self._partial / f"{name}.npy").resolve()
        return ArrayFile(path, array.shape, array.dtype.str, header_bytes)

    def file_path(self, name: str) -> Path:
        """Where to write a file that is not an array (weights, HDF5, PNG)."""
        self._files.add(name)
        path = self._partial / name
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def record(self, **extra: Any) -> None:
        """Add JSON values (a sequence index, results) to the manifest's top level."""
        if clash := _WRITERS_KEYS.keys() & extra.keys():
            raise ValueError(f"manifest keys {sorted(clash)} are the writer's own")
        self._extra.update(extra)

    def record_measured(self, **values: Any) -> None:
        """Add values that differ from run to run (seconds, rates) to `provenance`."""
        self._measured.update(values)

    def finish(
        self, *, config: Mapping[str, Any] | None = None, upstream: Mapping[str, str] | None = None
    ) -> Artifact:
        """Hash everything, write the manifest, rename the folder into place.

        Where an array is not finite all is discarded: the same inputs would give the same again.
        """
        try:
            arrays = {name: self._describe_array(name) for name in sorted(self._units)}
        except DsnetError:
            self.discard()
            raise
        held = [f"{name}.npy" for name in arrays]
        files = sorted(self._files - {*held})
        manifest = {
            **self._manifest,
            **self._extra,
            "arrays": arrays,
            "files": {name: self._describe(name) for name in files},
            "upstream": dict(upstream or {}),
            "config": dict(config or {}),
        }
        # As it will be read: tuples are lists there, and keys are strings.
        manifest = json.loads(json.dumps(manifest))
        manifest["sha256"] = content_digest(manifest)
        self._remove_undeclared()
        stamps = {name: stamp_of(self._partial / name) for name in (*held, *files)}
        made = {
            **provenance(time.perf_counter() - self._started),
            **self._measured,
            "stamps": {name: stamp for name, stamp in stamps.items() if stamp},
        }
        made = json.loads(json.dumps(made))
        manifest["provenance"] = {**made, "sha256": json_sha256(made)}
        # From here on the artifact is whole: if killed, `settle` does the rest.
        write_text_atomically(self._partial / MANIFEST, json.dumps(manifest, indent=1) + "\n")
        settle(self.path)
        return Artifact(self.path, manifest)

    def discard(self) -> None:
        # Without its mark, half of what is left after a kill is not taken for checkpoints.
        self._mark.unlink(missing_ok=True)
        shutil.rmtree(self._partial, ignore_errors=True)

    def _describe(self, name: str) -> dict[str, Any]:
        path = self._partial / name
        return {"sha256": file_sha256(path), "bytes": path.stat().st_size}

    def _describe_array(self, name: str) -> dict[str, Any]:
        path = self._partial / f"{name}.npy"
        array = map_npy(path)
        for row, values in enumerate(np.atleast_1d(array)):  # a whole one may not fit the memory
            if array.dtype.kind in "fc" and not np.isfinite(values).all():
                raise DsnetError(
                    f"stage {self._manifest['kind']!r} with NaN or infinity in {name}[{row}]",
                    "finite numbers only",
                    "Nothing was kept: check options and inputs of this stage and those before.",
                )
        return {
            "shape": list(array.shape),
            "dtype": str(array.dtype),
            "unit": self._units[name],
            "sha256": file_sha256(path),
        }

    def _remove_undeclared(self) -> None:
        """Remove what a killed process's temporary files left behind."""
        kept = {self._partial / name for name in self._files}
        kept |= {self._partial / f"{name}.npy" for name in self._units}
        kept |= {parent for path in kept for parent in path.parents}
        for path in sorted(self._partial.rglob("*"), reverse=True):
            if path in kept or self.checkpoints in (path, *path.parents):
                continue
            if path.is_dir() and not path.is_symlink():
                path.rmdir()
            else:
                path.unlink()


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


def provenance(wall_time_s: float) -> dict[str, Any]:
    """When, where, by which command and with which versions something was made."""
    versions = {name: found for name in _RECORDED_PACKAGES if (found := version_of(name))}
    largest = 0
    if resource:  # of this process, or of one that it has started
        whose = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
        largest = max(resource.getrusage(one).ru_maxrss for one in whose)
    return {
        "command": [Path(sys.argv[0]).name, *sys.argv[1:]],
        "finished_utc": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "wall_time_s": round(wall_time_s, 3),
        "peak_memory_mb": round(largest / (2**20 if sys.platform == "darwin" else 2**10)),
        "machine": f"{machine()}, {os.cpu_count()} cores",
        "versions": {"python": platform.python_version(), **versions},
    }


def machine() -> str:
    """System and processor, such as `Linux AMD EPYC`: times say nothing without."""
    cpuinfo = Path("/proc/cpuinfo")  # only Linux has it
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    processor = names[0] if names else platform.processor() or platform.machine()
    return f"{platform.system()} {processor}"
