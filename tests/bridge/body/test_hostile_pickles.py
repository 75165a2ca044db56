"""Known ways past restricted unpicklers: nothing runs, nothing grows, and the interpreter lives."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body import load_body_model
from bridge.body.pickled_arrays import as_array
from bridge.body.safe_pickle import load_restricted
from tests.forged.python2_pickle import python2_pickle

_ARRAY = b"cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\n(I0\ntS'b'\ntR"
_OBJECTS = b"cnumpy\ndtype\n(S'O8'\nI0\nI1\ntR(I3\nS'|'\nNNNI-1\nI-1\nI63\ntb"
_DOUBLES = b"cnumpy\ndtype\n(S'f8'\nI0\nI1\ntR(I3\nS'<'\nNNNI-1\nI-1\nI0\ntb"
_STRUCTURE = b"cnumpy\ndtype\n(S'V8'\nI0\nI1\ntR(I3\nS'|'\nN(S'a'\nt}I8\nI1\nI16\ntb"
_DEEP = b")" + b"\x85" * 150_000
_LAUGHS = b"]q\x00" + b"".join(b"0](" + b"h%c" % n * 10 + b"eq%c" % (n + 1) for n in range(30))


def _in_a_field(value: bytes) -> bytes:
    return b"\x80\x04}S'v_template'\n" + value + b"s."


@pytest.mark.parametrize(
    ("payload", "complaint"),
    [
        pytest.param(b"\x80\x04\x8c\x05numpy\x8c\x0bf2py.os.sys\x93.", "it asks to run numpy.f2py",
                     id="dotted name"),
        pytest.param(b"\x80\x04\x8c\x06chumpy\x8c\x09os.system\x93\x8c\x04true\x85R.",
                     "it holds a Record", id="dotted name below chumpy"),
        pytest.param(b"\x80\x04\x8c\x02os\x8c\x06system\x93\x8c\x04true\x85R.", "it asks to run os",
                     id="STACK_GLOBAL"),
        pytest.param(b"\x80\x02\x82\x01.", "opcode 130", id="ext registry"),
        pytest.param(b"Pabc\n.", "opcode 80", id="persistent id"),
        pytest.param(b"\x80\x02K\x01Q.", "opcode 81", id="binary persistent id"),
        pytest.param(b"\x80\x04cchumpy\nCh\n)}\x92.", "opcode 146", id="NEWOBJ_EX"),
        pytest.param(b"(ios\nsystem\n.", "opcode 105", id="INST"),
        pytest.param(b"(cchumpy\nCh\no.", "opcode 111", id="OBJ"),
        pytest.param(b"c_codecs\nencode\n}S'__defaults__'\nS'rot13'\nsb.", "it asks to change",
                     id="BUILD of a function"),
        pytest.param(b"cchumpy\nCh\n}S'to_array'\nNsb.", "asks to change", id="BUILD of a class"),
        pytest.param(b"cchumpy\nCh\n)\x81(N}S'to_array'\nNstb)R.", "something that it made",
                     id="REDUCE of a record"),
        pytest.param(b"ccopyreg\n__newobj__\n.", "it asks to run copyreg", id="copyreg"),
        pytest.param(b"ccopyreg\n_reconstructor\n(cnumpy\ndtype\nc__builtin__\nobject\nNtR.",
                     "construct something else", id="_reconstructor of another"),
        pytest.param(b"c__builtin__\nobject\n)R.", "it asks to construct", id="object"),
        pytest.param(b"\x80\x02Nr\xff\xff\xff\x7f.", "it holds a NoneType", id="memo index"),
        pytest.param(b"\x80\x04\x95" + struct.pack("<Q", 2**40), "it ends early", id="frame"),
        pytest.param(b"\x80\x04\x8e" + struct.pack("<Q", 2**40), "bytes at once", id="terabyte"),
        pytest.param(b"\x80\x05\x96" + struct.pack("<Q", 2**40), "bytes at once", id="bytearray"),
        pytest.param(b"\x80\x02" + b"]" * 300_000 + b".", "more than 200000", id="many objects"),
        pytest.param(b"\x80\x02}" + _DEEP + b"Ns.", "keys that are no names", id="deep key"),
        pytest.param(b"\x80\x02c__builtin__\nset\n](" + _DEEP + b"e\x85R.", "it holds a NoneType",
                     id="set of a deep value"),
        pytest.param(b"\x80\x04\x8f(" + _DEEP + b"\x90.", "it holds a NoneType", id="ADDITEMS"),
    ],
)  # fmt: skip
def test_bypasses_are_refused(tmp_path: Path, payload: bytes, complaint: str) -> None:
    path = tmp_path / "model.pkl"
    path.write_bytes(payload)
    with pytest.raises(DsnetError, match=rf"cannot be read safely .*{complaint}") as caught:
        load_body_model(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("value", "complaint"),
    [
        # Given to NumPy's own __setstate__, this kills the interpreter.
        pytest.param(_ARRAY + b"(I1\n(I100000\nt" + _OBJECTS + b"I00\n(lI1\naI2\natb",
                     "neither numbers nor text", id="objects fewer than the shape"),
        pytest.param(_ARRAY + b"(I1\n(I100000\nt" + _DOUBLES + b"I00\nS'abc'\ntb",
                     "smaller than requested", id="bytes fewer than the shape"),
        pytest.param(_ARRAY + b"(I1\n(I-1\nt" + _DOUBLES + b"I00\nS'abc'\ntb", "a shape that is",
                     id="negative shape"),
        pytest.param(_ARRAY + b"(I1\n(L1000000000000L\nt" + _DOUBLES + b"I00\nS''\ntb",
                     "an array of shape", id="petabytes"),
        pytest.param(_ARRAY + b"(I1\n(I1\nt" + _STRUCTURE + b"I00\nS'abcdefgh'\ntb",
                     "an array of structures", id="structure"),
        pytest.param(_ARRAY, "an array without its values", id="no state"),
        pytest.param(b"cnumpy.core.multiarray\nscalar\n(" + _OBJECTS + b"S'abcdefgh'\ntR",
                     "neither numbers nor text", id="scalar object"),
        pytest.param(_LAUGHS, "a list in place of an array", id="a billion laughs"),
        pytest.param(b"cscipy.sparse\ncsc_matrix\n)\x81}(S'_shape'\n(I1000000\nI1000000\ntS'data'\nNub",
                     "an array of shape", id="sparse terabytes"),
        pytest.param(b"cchumpy\nCh\n)\x81}S'x'\nlsb", "a list in place|stack|pop", id="no mark"),
    ],
)  # fmt: skip
def test_values_that_are_no_arrays_are_refused(value: bytes, complaint: str) -> None:
    with pytest.raises(Exception, match=complaint):
        as_array(load_restricted(io.BytesIO(_in_a_field(value)))["v_template"])


def test_memoised_text_is_not_copied_for_every_use() -> None:
    """A few bytes an opcode must not each become a megabyte."""
    text = b"X" + struct.pack("<I", 1 << 20) + b"a" * (1 << 20) + b"q\x00"
    uses = b"c_codecs\nencode\nq\x01" + b"h\x01h\x00\x85R" * 1000
    found = load_restricted(io.BytesIO(b"\x80\x02(" + text + uses + b"l."))
    assert len({id(one) for one in found if isinstance(one, str)}) == 1


@pytest.mark.parametrize("kind", ["<f8", ">f8", "<f4", "<f2", "|i1", "<u4"])
def test_every_type_of_numbers_is_rebuilt(kind: str) -> None:
    array = np.arange(12).reshape(3, 4).astype(kind)
    for content in (array, np.asfortranarray(array), array[1, 2]):
        found = as_array(load_restricted(io.BytesIO(python2_pickle(content))))
        np.testing.assert_array_equal(found, content)
        assert found.dtype == content.dtype
