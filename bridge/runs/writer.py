"""Who fills an artifact, in pieces that outlive a kill, and what is noted about its making."""

from __future__ import annotations

import json
import platform
import shutil
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from bridge.errors import DsnetError
from bridge.installation import version_of
from bridge.processes import usable_cores
from bridge.runs.artifact import (
    SCHEMA_VERSION,
    WRITERS_KEYS,
    Artifact,
    DataOrigin,
    content_digest,
    read_artifact,
)
from bridge.runs.files import (
    MANIFEST,
    ArrayFile,
    file_sha256,
    json_sha256,
    remove_work,
    stamp_of,
    work_folder,
    write_text_atomically,
)
from bridge.runs.untrusted import map_npy

try:
    import resource
except ModuleNotFoundError:  # Windows
    resource = None

_MADE = "made"
_RECORDED_PACKAGES = ("numpy", "scipy", "torch", "tensorflow", "keras")


class ArtifactWriter:
    """Fills a folder in the work folder of `path`; `finish` renames it to `path`.

    What it has written outlives a killed process: a stage that keeps its checkpoints under
    `checkpoints` finds them there when it is started again with the same `fingerprint`; with
    another one it begins anew. The artifact holds what was declared (`put`, `array_file`,
    `file_path`) and nothing else.
    """

    def __init__(
        self, path: Path | str, kind: str, *, data: DataOrigin, fingerprint: str = ""
    ) -> None:
        self.path = Path(path)
        work = work_folder(self.path)
        self.checkpoints = work / "checkpoints"
        """Folder for checkpoints; it vanishes when the artifact is finished."""
        self._made, self._replaced = work / _MADE, work / "replaced"
        self._manifest: dict[str, Any] = {"schema": SCHEMA_VERSION, "kind": kind, "data": data}
        self._units: dict[str, str] = {}
        self._files: set[str] = set()
        self._extra: dict[str, Any] = {}
        self._measured: dict[str, Any] = {}
        mark, expected = work / "fingerprint", fingerprint.encode()
        whole = mark.is_file() and self._made.is_dir()
        if not (expected and whole and mark.read_bytes() == expected):
            mark.unlink(missing_ok=True)  # first: half of what is removed is no checkpoint
            self.discard()
            self._made.mkdir(parents=True)
            self.checkpoints.mkdir()
            write_text_atomically(mark, fingerprint)
        # As if this turn had begun so much earlier.
        self._started = time.perf_counter() - self._earlier_turns_s()

    def _earlier_turns_s(self) -> float:
        """Seconds of the turns before, which were killed: each counts to the last file it wrote."""
        kept, before_s = self.checkpoints / "turns", 0.0
        try:
            earlier_s, began = map(float, kept.read_text(encoding="utf-8").split())
            written = [path.stat().st_mtime for path in kept.parents[1].rglob("*") if path != kept]
            before_s = max(0.0, earlier_s) + max(0.0, max(written) - began)
        except (OSError, ValueError):  # none, or a damaged one: no reason to stop work
            pass
        write_text_atomically(kept, f"{before_s} {time.time()}")
        return before_s

    def put(self, name: str, array: ArrayLike, unit: str) -> None:
        """Store a whole array as `<name>.npy`; `unit` goes to the manifest."""
        values = np.ascontiguousarray(array)
        self.array_file(name, values.shape, values.dtype, unit).write(0, values)

    def array_file(
        self, name: str, shape: tuple[int, ...], dtype: DTypeLike, unit: str
    ) -> ArrayFile:
        """`<name>.npy`, to be filled in pieces; a resumed stage finds what it wrote."""
        self._units[name] = unit
        return ArrayFile.at(self._made / f"{name}.npy", shape, dtype)

    def file_path(self, name: str) -> Path:
        """Where to write a file that is not an array (weights, HDF5, PNG)."""
        self._files.add(name)
        path = self._made / name
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def record(self, **extra: Any) -> None:
        """Add JSON values (a sequence index, results) to the manifest's top level."""
        if clash := WRITERS_KEYS.keys() & extra.keys():
            raise ValueError(f"manifest keys {sorted(clash)} are the writer's")
        self._extra.update(extra)

    def record_measured(self, **values: Any) -> None:
        """Add values that differ from run to run (seconds, rates) to `provenance`."""
        self._measured.update(values)

    def record_inputs(self, paths: Mapping[str, str], stamps: Mapping[str, Any]) -> None:
        """Add where files lie that it was made from, by their names upstream, and their stamps."""
        self._measured.update(inputs={**paths}, stamps={**stamps})

    def finish(
        self, *, config: Mapping[str, Any] | None = None, upstream: Mapping[str, str] | None = None
    ) -> Artifact:
        """Hash everything, write the manifest, rename the folder into place.

        Where an array is not finite all is discarded: the same inputs would give the same again.
        """
        arrays = {name: self._describe_array(name) for name in sorted(self._units)}
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
        stamps = {name: stamp_of(self._made / name) for name in (*held, *files)}
        stamps |= self._measured.pop("stamps", {})
        made = {
            **provenance(time.perf_counter() - self._started),
            **self._measured,
            "stamps": {name: stamp for name, stamp in stamps.items() if stamp},
        }
        made = json.loads(json.dumps(made))
        manifest["sha256"] = content_digest(manifest)
        manifest["provenance"] = {**made, "sha256": json_sha256(made)}
        self._remove_undeclared()
        write_text_atomically(self._made / MANIFEST, json.dumps(manifest, indent=1) + "\n")
        # A folder cannot be renamed over a full one, so the old one steps aside first.
        shutil.rmtree(self._replaced, ignore_errors=True)
        if self.path.exists():
            self.path.rename(self._replaced)
        self._made.rename(self.path)
        self.discard()
        return read_artifact(self.path)

    def discard(self) -> None:
        remove_work(self.path)

    def _describe(self, name: str) -> dict[str, Any]:
        path = self._made / name
        return {"sha256": file_sha256(path), "bytes": path.stat().st_size}

    def _describe_array(self, name: str) -> dict[str, Any]:
        path = self._made / f"{name}.npy"
        array = map_npy(path)
        for row, values in enumerate(np.atleast_1d(array)):  # a whole one may not fit the memory
            if array.dtype.kind in "fc" and not np.isfinite(values).all():
                self.discard()
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
        kept = {self._made / name for name in self._files}
        kept |= {self._made / f"{name}.npy" for name in self._units}
        kept |= {parent for path in kept for parent in path.parents}
        for path in sorted({*self._made.rglob("*")} - kept, reverse=True):
            if path.is_dir() and not path.is_symlink():
                path.rmdir()
            else:
                path.unlink()


def is_begun(path: Path) -> bool:
    """Whether beside the artifact `path` lies another's making, which can be gone on with."""
    return (work_folder(path) / _MADE).is_dir()


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
    versions = {name: version for name in _RECORDED_PACKAGES if (version := version_of(name))}
    largest = 0
    if resource:  # of this process, or of one that it has started
        whose = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
        largest = max(resource.getrusage(one).ru_maxrss for one in whose)
    return {
        "command": [Path(sys.argv[0]).name, *sys.argv[1:]],
        "finished_utc": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "wall_time_s": round(wall_time_s, 3),
        "peak_memory_mb": round(largest / (2**20 if sys.platform == "darwin" else 2**10)),
        "machine": f"{machine()}, {usable_cores()} cores",
        "versions": {"python": platform.python_version(), **versions},
    }


def machine() -> str:
    """System and processor, such as `Linux AMD EPYC`: times say nothing without."""
    cpuinfo = Path("/proc/cpuinfo")  # only Linux has it
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    processor = names[0] if names else platform.processor() or platform.machine()
    return f"{platform.system()} {processor}"
