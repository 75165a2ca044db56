"""Writing artifacts: beside their final place, and renamed into it when they are whole."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from bridge.errors import DsnetError
from bridge.runs.array_file import ArrayFile
from bridge.runs.artifact import (
    SCHEMA_VERSION,
    WRITERS_KEYS,
    Artifact,
    DataOrigin,
    content_digest,
)
from bridge.runs.digests import file_sha256, json_sha256, remember
from bridge.runs.folders import (
    CHECKPOINTS,
    MANIFEST,
    partial_folder,
    settle,
    write_text_atomically,
)
from bridge.runs.provenance import provenance
from bridge.runs.storage import map_array, map_npy, save_array
from bridge.runs.work_time import WorkTime

_BLOCK_ELEMENTS = 1 << 22


class ArtifactWriter:
    """Fills `.<name>.partial` beside `path`; `finish` renames it to `path`.

    The partial folder outlives a killed process: a stage that keeps its
    checkpoints under `checkpoints` finds them there when it is started again
    with the same `fingerprint`; with another one the folder is emptied.
    The artifact holds what was declared (`put`, `open_array`, `file_path`) and nothing else.
    """

    def __init__(
        self, path: Path | str, kind: str, *, data: DataOrigin, fingerprint: str = ""
    ) -> None:
        self.path = Path(path)
        self._partial = partial_folder(self.path)
        self._manifest: dict[str, Any] = {"schema": SCHEMA_VERSION, "kind": kind, "data": data}
        self._units: dict[str, str] = {}
        self._files: set[str] = set()
        self._extra: dict[str, Any] = {}
        self._measured: dict[str, Any] = {}
        self._prepare(fingerprint)
        made = (file for file in self._partial.rglob("*") if file.is_file())
        self._time = WorkTime(self.checkpoints / "work_time.json", made)

    def _prepare(self, fingerprint: str) -> None:
        settle(self.path)
        mark = fingerprint.encode()
        if mark and self._mark.is_file() and self._mark.read_bytes() == mark:
            return
        self.discard()
        self.checkpoints.mkdir(parents=True)
        write_text_atomically(self._mark, fingerprint)

    @property
    def checkpoints(self) -> Path:
        """Folder for checkpoints; it vanishes when the artifact is finished."""
        return self._partial / CHECKPOINTS

    @property
    def _mark(self) -> Path:
        return self.checkpoints / "fingerprint"

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
        if clash := WRITERS_KEYS & set(extra):
            raise ValueError(f"manifest keys {sorted(clash)} are the writer's own")
        self._extra.update(extra)

    def record_measured(self, **values: Any) -> None:
        """Add values that differ from run to run (seconds, rates) to `provenance`."""
        self._measured.update(values)

    def finish(
        self, *, config: Mapping[str, Any] | None = None, upstream: Mapping[str, str] | None = None
    ) -> Artifact:
        """Hash everything, write the manifest, rename the folder into place.

        Raises
        ------
        DsnetError
            If an array is not finite; everything written is discarded, as the same inputs would
            give the same again.
        """
        try:
            arrays = {name: self._describe_array(name) for name in sorted(self._units)}
        except DsnetError:
            self.discard()
            raise
        manifest = {
            **self._manifest,
            **self._extra,
            "arrays": arrays,
            "files": {name: self._describe(name) for name in self._declared_files()},
            "upstream": dict(upstream or {}),
            "config": dict(config or {}),
        }
        # As it will be read: tuples are lists there, and keys are strings.
        manifest = json.loads(json.dumps(manifest))
        manifest["sha256"] = content_digest(manifest)
        made = json.loads(json.dumps({**provenance(self._time.seconds), **self._measured}))
        manifest["provenance"] = {**made, "sha256": json_sha256(made)}
        self._remove_undeclared()
        # From here on the artifact is whole: if killed, `settle` does the rest.
        write_text_atomically(self._partial / MANIFEST, json.dumps(manifest, indent=1) + "\n")
        settle(self.path)
        artifact = Artifact(self.path, manifest)
        remember((self.path / name, digest) for name, digest in artifact.digests.items())
        return artifact

    def discard(self) -> None:
        """Forget everything written so far."""
        # Without its mark, half of what is left after a kill is not taken for checkpoints.
        self._mark.unlink(missing_ok=True)
        shutil.rmtree(self._partial, ignore_errors=True)

    def _describe(self, name: str) -> dict[str, Any]:
        path = self._partial / name
        return {"sha256": file_sha256(path), "bytes": path.stat().st_size}

    def _describe_array(self, name: str) -> dict[str, Any]:
        path = self._partial / f"{name}.npy"
        array = map_npy(path)
        if (index := _first_not_finite(array)) is not None:
            place = f"{name}[{', '.join(map(str, index))}]"
            raise DsnetError(
                f"stage {self._manifest['kind']!r} with {array[index]} at {place}",
                "finite numbers only",
                "Nothing was kept: check the options and inputs of this and the stages before it.",
            )
        return {
            "shape": list(array.shape),
            "dtype": str(array.dtype),
            "unit": self._units[name],
            "sha256": file_sha256(path),
        }

    def _declared_files(self) -> list[str]:
        return sorted(self._files - {f"{name}.npy" for name in self._units})

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


def _first_not_finite(array: NDArray[Any]) -> tuple[int, ...] | None:
    """Index of the first number of a float array that is not finite."""
    if array.dtype.kind not in "fc":
        return None
    flat = array.reshape(-1)
    for start in range(0, flat.size, _BLOCK_ELEMENTS):
        finite = np.isfinite(flat[start : start + _BLOCK_ELEMENTS])
        if not finite.all():
            first = start + int(np.argmin(finite))
            return tuple(int(i) for i in np.unravel_index(first, array.shape))
    return None


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
