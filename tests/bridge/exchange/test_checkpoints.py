"""A checkpoint is what was written, or none."""

from __future__ import annotations

import numpy as np
import pytest

from bridge.exchange import save_weights
from bridge.exchange.checkpoints import load_checkpoint, save_checkpoint

ARRAYS = {"a": np.arange(6.0).reshape(2, 3), "b": np.zeros((0, 4), np.float32)}


def test_it_comes_back(tmp_path, capsys):
    save_checkpoint(tmp_path / "c", ARRAYS)
    found = load_checkpoint(tmp_path / "c")
    assert found is not None
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(found[name], array, strict=True)
    assert load_checkpoint(tmp_path / "none") is None
    assert capsys.readouterr().err == ""


def test_every_changed_byte_makes_it_none_or_the_same(tmp_path, capsys):
    path = tmp_path / "c"
    save_checkpoint(path, ARRAYS)
    content = path.read_bytes()
    named = 0
    for place in range(len(content)):
        path.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
        found = load_checkpoint(path)
        if found is not None:
            for name, array in ARRAYS.items():
                np.testing.assert_array_equal(found[name], array, strict=True)
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == (found is None)
        named += found is None
    assert named > 0.9 * len(content)


@pytest.mark.parametrize("kept", [0, 7, 60, -1])
def test_a_cut_one_is_none(kept, tmp_path):
    path = tmp_path / "c"
    save_checkpoint(path, ARRAYS)
    path.write_bytes(path.read_bytes()[:kept])
    assert load_checkpoint(path) is None


def test_weights_without_a_digest_are_none(tmp_path):
    save_weights(tmp_path / "c", ARRAYS)
    assert load_checkpoint(tmp_path / "c") is None
