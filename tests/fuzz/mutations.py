"""Ways to damage files: bytes, headers and members of NumPy's files, JSON.

They draw what they do, and are no strategies themselves: hypothesis would keep each of these,
with the file that it was given.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Mapping
from copy import deepcopy
from typing import Any

import numpy as np
from hypothesis import strategies as st

Draw = Callable[[st.SearchStrategy], Any]
Files = dict[str, bytes]

ODD_NUMBERS = (
    0, 1, -1, 2, 3, 7, 24, 69, 255, 256, 6890, 2**15, 2**31 - 1, 2**31, 2**32, 2**53, 2**63, 10**30,
)  # fmt: skip
ODD_VALUES = (0.0, -0.0, np.nan, np.inf, -np.inf, 1e-320, 1e10, 1e39, 1e160, 1e300, -5.0, 0.25, 1e3)
ODD_NAMES = (
    "../../v_template.npy", "/etc/passwd", "..", ".", "", "a/../../b", "a\nb", "\x1b[2J", "\x00",
    "<script>alert(1)</script>", "\u202e", "x" * 5000, "a\\b", "con", "é", "![x](http://a.b/c.png)",
)  # fmt: skip
ODD_DTYPES = (
    "<f8", ">f8", "<f4", "<f2", "|i1", "<i8", ">u4", "<c16", "|b1", "|O", "|S5", "<U3", "|V8",
    "|S0", "<M8[ns]", "<f16", "|S1000000000", "O", "x", "[('a','<f8')]", "('<f8',(1000,1000))",
)  # fmt: skip
ODD_JSON = (
    None, True, 0, -1, 1.5, 10**30, float("nan"), float("inf"), "", "x", "../../etc/passwd", [], {},
    [[]], {"": None}, ["a", 1], {"sha256": 1}, "\x1b[31m", "a\nb", [10**12, 10**12], [-1], "O",
)  # fmt: skip


def damaged(draw: Draw, content: bytes) -> bytes:
    """Bytes that were cut, flipped, overwritten, doubled or filled up, at up to four places."""
    data = bytearray(content)
    for _ in range(draw(st.integers(1, 4))):
        # The ends of files hold their headers and directories.
        end = draw(st.sampled_from((64, 1024, 8192, len(data) + 1)))
        place = draw(st.integers(0, min(end, len(data))))
        place = len(data) - place if draw(st.booleans()) else place
        how = draw(st.sampled_from(["cut", "flip", "put", "insert", "remove", "double"]))
        if how == "cut":
            del data[place:]
        elif how == "flip" and place < len(data):
            data[place] ^= 1 << draw(st.integers(0, 7))
        elif how == "put":
            data[place : place + 8] = _odd_bytes(draw)
        elif how == "insert":
            data[place:place] = _odd_bytes(draw)
        elif how == "remove":
            del data[place : place + draw(st.integers(1, 64))]
        elif how == "double":
            data[place:place] = data[place : place + draw(st.integers(1, 4096))]
    return bytes(data)


def _odd_bytes(draw: Draw) -> bytes:
    if draw(st.booleans()):
        return draw(st.binary(min_size=1, max_size=16))
    size = draw(st.sampled_from((1, 2, 4, 8)))
    return (draw(st.sampled_from(ODD_NUMBERS)) % 256**size).to_bytes(size, "little")


def npy(array: np.ndarray) -> bytes:
    """The bytes of an array's file."""
    stream = io.BytesIO()
    np.lib.format.write_array(stream, array, allow_pickle=False)
    return stream.getvalue()


def damaged_npy(draw: Draw, array: np.ndarray) -> bytes:
    """An array's file with other values, another shape or type, or another header."""
    how = draw(st.sampled_from(["value", "type", "shape", "header", "bytes"]))
    if how == "value":
        changed = array.astype(np.float64).ravel() if array.dtype.kind in "iuf" else array.ravel()
        if changed.size and array.dtype.kind in "iuf":
            places = draw(st.sampled_from((slice(0, 1), slice(None), slice(None, None, 7))))
            with np.errstate(all="ignore"):
                if draw(st.booleans()):
                    changed[places] = draw(st.sampled_from(ODD_VALUES))
                else:
                    changed[places] *= draw(st.sampled_from(ODD_VALUES))
        return npy(changed.reshape(array.shape))
    if how == "type":
        kind = draw(st.sampled_from(("i1", "u1", "f2", "f4", ">f8", "c16", "b1", "S3", "U2", "i8")))
        with np.errstate(all="ignore"):
            is_text = kind[0] in "SU" or array.dtype.kind in "SU"
            return npy(np.zeros(array.shape, kind) if is_text else array.astype(kind))
    if how == "shape":
        return npy(_reshaped(draw, array))
    if how == "header":
        return _header(draw, array) + array.tobytes()
    return damaged(draw, npy(array))


def _reshaped(draw: Draw, array: np.ndarray) -> np.ndarray:
    how = draw(st.sampled_from(["flat", "none", "more", "fewer", "turned", "point"]))
    if how == "fewer" and array.ndim:
        return array[: draw(st.integers(0, max(len(array) - 1, 0)))]
    if how == "turned":
        return array.T
    if how == "more":
        return array[None]
    if how == "none":
        return array[..., :0] if array.ndim else array.reshape(1)[:0]
    return array.ravel() if how == "flat" else np.array(1.0)


def _header(draw: Draw, array: np.ndarray) -> bytes:
    """A header with numbers, types and lengths of its own."""
    sizes = st.sampled_from((*ODD_NUMBERS, *array.shape))
    shape = tuple(draw(st.lists(sizes, max_size=5)))
    kind = draw(st.sampled_from((array.dtype.str, *ODD_DTYPES)))
    kind = kind if kind[0] in "[(" else repr(kind)
    text = f"{{'descr': {kind}, 'fortran_order': {draw(st.booleans())}, 'shape': {shape}, }}"
    text = draw(
        st.sampled_from((text, text, text[:-2], "(" * 300, text * 200, text.replace(",", "{")))
    )
    version = draw(st.sampled_from((b"\x01\x00", b"\x02\x00", b"\x03\x00", b"\x09\x09")))
    length = draw(st.sampled_from((len(text), len(text), 0, 2**16 - 1)))
    size = 2 if version == b"\x01\x00" else 4
    return b"\x93NUMPY" + version + (length % 256**size).to_bytes(size, "little") + text.encode()


def zipped(members: Mapping[str, bytes], compression: int = zipfile.ZIP_STORED) -> bytes:
    """An archive of these members."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", compression) as archive:
        for name, content in members.items():
            archive.writestr(name.replace("\x00", "0") or "empty", content)
    return stream.getvalue()


def damaged_npz(draw: Draw, arrays: Mapping[str, np.ndarray]) -> bytes:
    """An archive with up to three members damaged, renamed, left out or replaced, then zipped."""
    members = {f"{name}.npy": npy(array) for name, array in arrays.items()}
    for _ in range(draw(st.integers(1, 3))):
        name = draw(st.sampled_from(sorted(arrays)))
        member = f"{name}.npy"
        how = draw(st.sampled_from(["array", "array", "array", "rename", "drop", "text", "pickle"]))
        content = members.pop(member, npy(arrays[name]))
        if how == "array":
            members[member] = damaged_npy(draw, arrays[name])
        elif how == "rename":
            members[draw(st.sampled_from(ODD_NAMES)) + draw(st.sampled_from(("", member)))] = (
                content
            )
        elif how == "text":
            members[member] = draw(st.binary(max_size=40))
        elif how == "pickle":
            stream = io.BytesIO()
            np.save(stream, np.array({"a": 1}, dtype=object), allow_pickle=True)
            members[member] = stream.getvalue()
    kinds = (zipfile.ZIP_STORED,) * 4 + (zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
    whole = zipped(members, draw(st.sampled_from(kinds)))
    return damaged(draw, whole) if draw(st.integers(0, 3)) == 0 else whole


def damaged_json(draw: Draw, value: Any) -> Any:
    """A JSON value with up to three of its parts replaced, renamed or left out."""
    value = json.loads(json.dumps(value))
    for _ in range(draw(st.integers(1, 3))):
        part, key = _some_part(draw, value)
        if part is None:
            return deepcopy(draw(st.sampled_from(ODD_JSON)))
        how = draw(st.sampled_from(["replace", "replace", "drop", "rename"]))
        if how == "drop":
            del part[key]
        elif how == "rename" and isinstance(part, dict):
            part[draw(st.sampled_from(ODD_NAMES))] = part.pop(key)
        else:
            part[key] = deepcopy(draw(st.sampled_from(ODD_JSON)))
    return value


def _some_part(draw: Draw, value: Any) -> tuple[Any, Any]:
    """A container somewhere in a JSON value and one of its keys; None where it is no container."""
    part, key = None, None
    while isinstance(value, (dict, list)) and value:
        keys = list(value) if isinstance(value, dict) else list(range(len(value)))
        part, key = value, draw(st.sampled_from(keys))
        value = part[key]
        if draw(st.integers(0, 2)) == 0:
            break
    return part, key
