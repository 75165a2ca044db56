"""A folder of motions as AMASS is one, and what is written of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bridge.runs import read_artifact
from tests.forged.amass import save, shape, smplh


def forge(folder: Path, count: int, frames: int = 12) -> Path:
    """Motions of several people, with what lies beside them in AMASS."""
    rng = np.random.default_rng(5)
    for number in range(count):
        poses = smplh(frames)["poses"] + np.cumsum(rng.normal(0, 0.01, (frames, 156)), axis=0)
        path = folder / f"Set{number % 2}" / f"{number % 3:02d}" / f"{number:03d}_poses.npz"
        gender = ("female", "male", "neutral")[number % 3]
        save(path, smplh(frames, 60.0), poses=poses, gender=gender)
    save(folder / "Set0" / "00" / "shape.npz", shape())
    (folder / "Set0" / "LICENSE.txt").write_text("as AMASS has it")
    return folder


def tree(out: Path) -> dict[str, bytes | str]:
    """All files: their bytes, and the digests of manifests, which also say when they were made."""
    files = (path for path in sorted(out.rglob("*")) if path.is_file())
    return {
        str(path.relative_to(out)): read_artifact(path.parent).content_sha256
        if path.name == "manifest.json"
        else path.read_bytes()
        for path in files
    }
