"""Forged artifacts: manifests and arrays, damaged or signed."""

from __future__ import annotations

import hashlib
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from bridge.motion.sequences import sequences_of
from bridge.runs import read_artifact, write_artifact
from bridge.runs.artifact import content_digest
from tests.fuzz.mutations import Draw, Files, damaged, damaged_json, damaged_npy, npy


def _artifact_base() -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        sequences = [
            {"name": "a_b", "subject": "a", "motion": "b", "start": 0, "length": 2, "fps": 60}
        ]
        write_artifact(
            Path(folder) / "a",
            "align",
            {"theta": np.arange(6.0).reshape(2, 3), "none": np.zeros((0, 3))},
            units={"theta": "m", "none": "1"},
            data="synthetic",
            sequences=sequences,
            config={"steps": 3},
        )
        return json.loads((Path(folder) / "a" / "manifest.json").read_text())


@st.composite
def _artifact(draw: Draw, base: dict[str, Any]) -> Files:
    arrays = {"theta": np.arange(6.0).reshape(2, 3), "none": np.zeros((0, 3))}
    theta = damaged_npy(draw, arrays["theta"]) if draw(st.booleans()) else None
    manifest = damaged_json(draw, base) if theta is None or draw(st.booleans()) else {**base}
    files = {"none.npy": npy(arrays["none"]), "theta.npy": theta or npy(arrays["theta"])}
    signed = draw(st.integers(0, 4)) > 0
    if signed and isinstance(manifest, dict):
        _sign(manifest, files)
    text = json.dumps(manifest).encode()
    odd = draw(st.integers(0, 9))
    text = {0: damaged(draw, text), 1: b"[" * 100_000}.get(odd, text) if odd < 2 else text
    return {**files, "manifest.json": text}


def _sign(manifest: dict[str, Any], files: Files) -> None:
    """Give a forged manifest the digests of what lies beside it."""
    arrays = manifest.get("arrays")
    for name, content in files.items():
        entry = arrays.get(name.removesuffix(".npy")) if isinstance(arrays, dict) else None
        if isinstance(entry, dict) and "sha256" in entry:
            entry["sha256"] = hashlib.sha256(content).hexdigest()
    manifest["sha256"] = content_digest(manifest)


def read(folder: Path) -> None:
    """All that it names."""
    artifact = read_artifact(folder)
    for name in artifact.manifest["arrays"]:
        artifact.array(name).sum()
    for name in artifact.manifest["files"]:
        assert artifact.file(name).resolve().is_relative_to(folder.resolve())
    sequences_of(artifact)
    artifact.verify()


def files() -> st.SearchStrategy[Files]:
    """A manifest and two arrays."""
    return _artifact(_artifact_base())
