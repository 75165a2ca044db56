"""Damaged packed files: other bytes, and files that say other things of themselves."""

from __future__ import annotations

import functools
import io
import json
import tempfile
from pathlib import Path

import numpy as np
from hypothesis import strategies as st

from bridge.exchange.packed import open_packed, write_packed
from bridge.runs.digests import json_sha256
from tests.fuzz.mutations import Draw, Files, damaged, damaged_json


@functools.cache
def _base() -> bytes:
    """A file of (200, 5, 3) offsets and another array."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "packed.npz"
        with write_packed(path, data="synthetic", kind="align") as writer:
            turns = np.arange(200.0)[:, None, None] / 9 + np.arange(15).reshape(5, 3)
            writer.add_bounded("offsets", np.sin(turns).astype(np.float32), "m", 1e-3)
            writer.add("theta", np.arange(4.0), "rad")
        return path.read_bytes()


@st.composite
def files(draw: Draw) -> Files:
    """Half of them with a digest that belongs to what they say."""
    if draw(st.booleans()):
        return {"packed.npz": damaged(draw, _base())}
    with np.load(io.BytesIO(_base())) as archive:
        members = {name: archive[name] for name in archive.files}
    content = damaged_json(draw, json.loads(str(members["about"]))["content"])
    about = {"content": content, "sha256": json_sha256(content)}
    members["about"] = np.array(json.dumps(about))
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **members)
    return {"packed.npz": buffer.getvalue()}


def read(folder: Path) -> None:
    """Every array."""
    with open_packed(folder / "packed.npz") as packed:
        for name in (*packed.bounded, *packed.exact):
            packed.array(name)
