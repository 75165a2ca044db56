"""Damaged mesh files in HDF5."""

from __future__ import annotations

import io
from pathlib import Path

import h5py
import numpy as np
from hypothesis import strategies as st

from bridge.body import load_body_model
from bridge.meshes.dyna_files import dyna_sequences
from tests.fuzz.mutations import ODD_NAMES, ODD_NUMBERS, Draw, Files, damaged


def _dyna_bases() -> list[bytes]:
    frames = np.moveaxis(np.stack([load_body_model("embedded:female").v_template] * 2), 0, -1)
    found = []
    for layout in ({}, {"chunks": (6890, 3, 1)}, {"chunks": (689, 3, 2), "compression": "gzip"}):
        stream = io.BytesIO()
        with h5py.File(stream, "w") as file:
            file.create_dataset("50004_hips", data=frames.astype("f4"), **layout)
        found.append(stream.getvalue())
    return found


@st.composite
def _dyna(draw: Draw, bases: list[bytes]) -> Files:
    if draw(st.integers(0, 3)):
        return {"dyna.h5": damaged(draw, draw(st.sampled_from(bases)))}
    stream = io.BytesIO(draw(st.sampled_from(bases)))
    with h5py.File(stream, "r+") as file:
        for _ in range(draw(st.integers(1, 3))):
            _odd_item(draw, file)
    return {"dyna.h5": stream.getvalue()}


def _odd_item(draw: Draw, file: h5py.File) -> None:
    """Add an item that is no sequence, or one of odd shape, type, name or place."""
    odd = st.sampled_from(ODD_NAMES)
    name = draw(st.one_of(odd, st.sampled_from(("faces", "50020_a", "50020_b", "x"))))
    name = name.replace("\x00", "").strip("/.") or "faces"
    how = draw(st.sampled_from(["data", "declared", "soft", "external", "group", "elsewhere"]))
    sizes = st.sampled_from((*ODD_NUMBERS[:-2], 13776))
    shape = tuple(abs(draw(sizes)) for _ in range(draw(st.integers(0, 4))))
    small = tuple(min(size, 5) for size in shape)
    kind = draw(st.sampled_from(("f4", "f8", "f2", "i4", "u1", "c8", "S4")))
    try:
        if how == "data":
            file[name] = np.zeros(small, kind)
        elif how == "declared":
            chunks = small if draw(st.booleans()) and all(small) and small else None
            file.create_dataset(name, shape, kind, chunks=chunks)
        elif how == "soft":
            file[name] = h5py.SoftLink(draw(st.sampled_from(("/50004_hips", "/none", "/", name))))
        elif how == "external":
            file[name] = h5py.ExternalLink(draw(st.sampled_from(("/dev/zero", "x.h5"))), "/a")
        elif how == "elsewhere":
            place = [("/dev/zero", 0, h5py.h5f.UNLIMITED)]
            file.create_dataset(name, (6890, 3, 2), "f4", external=place)
        else:
            file.create_group(name)
    # What the library refuses to write nobody can be sent.
    except (ValueError, OSError, TypeError, RuntimeError, OverflowError, MemoryError):
        pass


def files() -> st.SearchStrategy[Files]:
    """Of every layout."""
    return _dyna(_dyna_bases())


def read(folder: Path) -> None:
    """Faces, and the first frames of every sequence."""
    for sequence in dyna_sequences([folder / "dyna.h5"]):
        sequence.read(0, 2)
