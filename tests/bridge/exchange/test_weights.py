"""Weights files: bit-exact round trips, one line for anything else."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge import DsnetError
from bridge.exchange import load_weights, save_weights


def test_round_trip_is_bit_exact_even_for_views(tmp_path):
    weights: dict[str, NDArray] = {
        "a/kernel": np.arange(6, dtype=np.float32).reshape(2, 3).T,
        "b": np.array([np.pi]),
        "step": np.array(7),
    }
    save_weights(tmp_path / "w.safetensors", weights, kind="test")
    back = load_weights(tmp_path / "w.safetensors")
    assert set(back) == set(weights)
    for name, array in weights.items():
        assert (back[name].dtype, back[name].shape) == (array.dtype, array.shape)
        np.testing.assert_array_equal(back[name], array)


@pytest.mark.parametrize("content", [None, b"", b"PK\x03\x04 zip", b"\xff" * 64])
def test_a_foreign_file_is_one_line(tmp_path, content):
    path = tmp_path / "w.safetensors"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(DsnetError, match="safetensors") as caught:
        load_weights(path)
    assert "\n" not in str(caught.value)


def _file(path, header, data=bytes(64)):
    text = json.dumps(header).encode()
    path.write_bytes(len(text).to_bytes(8, "little") + text + data)
    return path


@pytest.mark.parametrize(("kind", "size"), [("BF16", 8), ("F8_E4M3", 4), ("F4", 4), ("C64", 32)])
def test_types_that_are_no_numbers_of_numpys_are_one_line(tmp_path, kind, size):
    entry = {"dtype": kind, "shape": [4], "data_offsets": [0, size]}
    with pytest.raises(DsnetError, match="does not load"):
        load_weights(_file(tmp_path / "w.safetensors", {"a": entry}, bytes(size)))


def test_what_is_no_file_or_has_a_huge_header_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "huge").write_bytes((99 << 20).to_bytes(8, "little") + b" " * (99 << 20))
    for path in (tmp_path / "pipe", "/dev/zero", tmp_path / "huge", tmp_path):
        with pytest.raises(DsnetError, match="does not load"):
            load_weights(path)
