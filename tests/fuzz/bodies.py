"""Damaged SMPL model files."""

from __future__ import annotations

import pickle
import pickletools
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from bridge.body import load_body_model
from tests.forged.python2_pickle import python2_pickle
from tests.forged.smpl import as_chumpy, smpl_fields
from tests.fuzz.mutations import Draw, Files, damaged, damaged_npz


def _smpl_arrays() -> dict[str, np.ndarray]:
    """A body whose blend shapes are zeros of one byte: five megabytes in place of fifty."""
    body = load_body_model("embedded:female")
    fields = smpl_fields(body)
    return {
        "v_template": body.v_template.astype(np.float32),
        "f": fields["f"],
        "weights": body.weights.astype(np.float32),
        "shapedirs": np.zeros((6890, 3, 10), np.int8),
        "posedirs": np.zeros((6890, 3, 207), np.int8),
        "J_regressor": fields["J_regressor"].toarray().astype(np.float32),
        "kintree_table": fields["kintree_table"],
        "dsnet_source": np.array("synthetic"),
    }


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


def npz_files() -> st.SearchStrategy[Files]:
    """Archives."""
    return _smpl_npz(_smpl_arrays())


def pickle_files() -> st.SearchStrategy[Files]:
    """Pickles."""
    return _smpl_pickle(_pickles(_smpl_arrays()))


def read(folder: Path) -> None:
    """Either."""
    (path,) = folder.iterdir()
    load_body_model(path)
