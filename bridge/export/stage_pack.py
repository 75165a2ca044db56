"""`dsnet pack`: an artifact's arrays in one small file, vertices within a stated error."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bridge.errors import DsnetError
from bridge.exchange.packed import write_packed
from bridge.export.new_path import new_path, refuse_taken
from bridge.options import PositiveFloat
from bridge.runs import Artifact, read_artifact
from bridge.runs.artifact import WRITERS_KEYS
from bridge.runs.processes import notify


@dataclass(frozen=True, kw_only=True)
class PackConfig:
    """Store the arrays of a folder in one file: offsets and vertices within a bound, all else
    exactly.

    Costs one core, most of it for deflating, and the memory of a block of 128 frames. `dsnet
    unpack` gives the arrays back.
    """

    folder: Path | None = None
    """A finished stage's folder, such as runs/demo/align, or one of `dsnet predict --motion`."""
    out: Path | None = None
    """File to write, `.npz`; it must not exist."""
    bound_mm: PositiveFloat = 0.01
    """How far any coordinate of an offset or vertex may be off, millimetres."""


PROFILES = {name: PackConfig() for name in ("smoke", "demo", "paper")}


def main(config: PackConfig) -> None:
    """Write the file and say what it saves.

    Raises
    ------
    DsnetError
        If an option is missing, the folder is no artifact or changed since it was written, `out`
        exists or cannot be written, or float32 cannot keep the bound.
    """
    folder, out = config.folder, config.out
    if folder is None or out is None:
        missing = "--folder" if folder is None else "--out"
        raise DsnetError(f"pack without {missing}", f"{missing} PATH", f"Pass {missing} PATH.")
    if out.suffix.lower() != ".npz":
        raise DsnetError(
            f"--out {out}",
            "a file whose name ends in .npz",
            f"Pass --out {out.with_suffix('.npz')}.",
        )
    refuse_taken(out)
    artifact = read_artifact(folder)
    if not artifact.manifest["arrays"]:
        raise DsnetError(f"{folder} without arrays", "an artifact with arrays", "Pass another one.")
    with new_path(out) as path:
        largest_m = pack(artifact, path, 1e-3 * config.bound_mm)
    for name, error_m in largest_m.items():
        notify(f"{name}: at most {1e3 * error_m:.2g} mm off")
    if left_out := sorted(artifact.manifest["files"]):
        notify(f"not packed, being no arrays: {', '.join(left_out)}")
    before = sum((folder / f"{name}.npy").stat().st_size for name in artifact.manifest["arrays"])
    after = out.stat().st_size
    notify(f"{out}: {before / 1e6:.1f} MB in {after / 1e6:.1f} MB, {before / after:.1f} to 1")


def pack(artifact: Artifact, path: Path, bound_m: float) -> dict[str, float]:
    """Write an artifact's arrays to a new file; gives the largest error of each that has one."""
    manifest, largest_m = artifact.manifest, {}
    facts = {
        "kind": manifest["kind"],
        "source_sha256": artifact.content_sha256,
        "upstream": manifest["upstream"],
        "config": manifest["config"],
        "manifest": {key: value for key, value in manifest.items() if key not in WRITERS_KEYS},
    }
    with write_packed(path, data=artifact.origin, **facts) as writer:
        for name, entry in sorted(manifest["arrays"].items()):
            array = artifact.array(name)
            if not _are_vertices(entry):
                writer.add(name, array, entry["unit"])
            else:
                largest_m[name] = writer.add_bounded(name, array, "m", bound_m)
    return largest_m


def _are_vertices(entry: dict[str, Any]) -> bool:
    """Whether an array is of vertices or offsets (T, V, 3) in metres."""
    shape = entry["shape"]
    of_points = len(shape) == 3 and shape[2] == 3 and shape[0] * shape[1] > 0
    return of_points and entry["dtype"] == "float32" and entry["unit"] == "m"
