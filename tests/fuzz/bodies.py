"""Damaged SMPL model files."""

from __future__ import annotations

import pickle
import pickletools
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from bridge.body import load_body_model
from tests.forged.bodies import LOADS, REFUSED, fields_of, forged, person
from tests.forged.python2_pickle import python2_pickle
from tests.forged.smpl import as_chumpy
from tests.fuzz.mutations import Draw, Files, damaged, damaged_npz


def _smpl_arrays() -> dict[str, np.ndarray]:
    """Of a small SMPL-X, with expressions."""
    fields = fields_of(person("smplx", expressions=10), np.float32)
    return fields | {"dsnet_source": np.array("synthetic"), "dsnet_shapes": np.array(10)}


@st.composite
def _smpl_npz(draw: Draw, arrays: dict[str, np.ndarray]) -> Files:
    return {"model.npz": damaged_npz(draw, arrays)}


GADGETS = (
    b"cos\nsystem\n(S'true'\ntR", b"\x8c\x08builtins\x8c\x04eval\x93", b"\x82\x01", b"Ppid\n",
    b"Q", b"cnumpy\nload\n", b"\x8c\x05numpy\x8c\x0bf2py.os.sys\x93", b"cchumpy\nCh\n)\x81",
    b"(lp0\n", b"0", b"cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\n(I0\ntS'b'\ntR",
    b"\x92", b"o", b"i", b"cnumpy\ndtype\n(S'O8'\nI0\nI1\ntR(I3\nS'|'\nNNNI-1\nI-1\nI63\ntb",
    b"\x85" * 200, b"]" * 200, b"r\xff\xff\xff\x7f", b"\x8e" + b"\xff" * 8,
    b"\x96" + b"\xff" * 7 + b"\x7f", b"(" * 500, b"2" * 60, b"\x8b\xff\xff\xff\x7f",
    b"X\xff\xff\xff\xff", b"\x95" + b"\xff" * 8, b"R", b"b", b"s", b"u", b".",
    b"c__builtin__\nset\n((lp1\ntR", b"c_codecs\nencode\n(S'x'\nS'rot13'\ntR", b"h\x00", b"g0\n",
    b"t", b"}S'__class__'\nNs", b"ccopyreg\n_reconstructor\n", b"c__builtin__\nobject\n",
    b"I01\n", b"\x94",
)  # fmt: skip


@st.composite
def _smpl_pickle(draw: Draw, bases: list[tuple[bytes, list[int]]]) -> Files:
    """A model's pickle with gadgets between its opcodes, or these alone."""
    content, places = draw(st.sampled_from(bases))
    if draw(st.integers(0, 4)) == 0:
        program = draw(st.lists(st.sampled_from(GADGETS), max_size=30))
        return {"model.pkl": b"\x80\x04" + b"".join(program) + b"."}
    for place in sorted(draw(st.lists(st.sampled_from(places), max_size=3)), reverse=True):
        gadget = draw(st.sampled_from(GADGETS))
        skipped = draw(st.sampled_from((0, 0, 1, len(gadget))))
        content = content[:place] + gadget + content[place + skipped :]
    return {"model.pkl": damaged(draw, content) if draw(st.booleans()) else content}


def _pickles(arrays: dict[str, np.ndarray]) -> list[tuple[bytes, list[int]]]:
    fields: dict[str, Any] = dict(arrays)
    kinds = [
        pickle.dumps(fields, 4),
        python2_pickle(fields, 2),
        python2_pickle(as_chumpy(fields), 2),
    ]
    kinds += [pickle.dumps({"v_template": np.zeros((3, 3))}, 2)]
    return [(one, [int(place or 0) for _, _, place in pickletools.genops(one)]) for one in kinds]


@st.composite
def _any(draw: Draw, contents: list[bytes]) -> Files:
    """Any container under any name, torn at any place; and what is taken for one."""
    name = draw(st.sampled_from(("SMPL_F.npz", "SMPL_F.pkl", "a.npy", "a.pth", "a.safetensors")))
    return {name: damaged(draw, draw(st.sampled_from(contents)))}


def _other_files() -> st.SearchStrategy[Files]:
    """Of every variety that loads, and every kind that is refused."""
    loaded = [forged(name)[1] for name in LOADS if "300" not in name]
    return _any([*loaded, *(content for _, content, _ in REFUSED.values())])


def npz_files() -> st.SearchStrategy[Files]:
    """Archives, and what else is taken for a body."""
    return st.one_of(_smpl_npz(_smpl_arrays()), _other_files())


def pickle_files() -> st.SearchStrategy[Files]:
    """Pickles."""
    return _smpl_pickle(_pickles(_smpl_arrays()))


def read(folder: Path) -> None:
    """Either."""
    (path,) = folder.iterdir()
    load_body_model(path)
