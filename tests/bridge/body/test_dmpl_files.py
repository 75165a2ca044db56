"""DMPL's directions: the first eight are read, anything else is one line."""

from __future__ import annotations

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body.smpl_files import load_dmpl_directions
from tests.forged.dmpl import forged_directions, save_dmpl


def test_the_first_eight_are_read(tmp_path):
    path = save_dmpl(tmp_path / "model.npz", count=10)
    np.testing.assert_array_equal(load_dmpl_directions(path), forged_directions(10)[..., :8])


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"dirs": forged_directions()}, "no 'eigvec'"),
        ({"eigvec": forged_directions(7)}, r"in shape \(6890, 3, 7\)"),
        ({"eigvec": forged_directions()[:6889]}, r"in shape \(6889, 3, 8\)"),
        ({"eigvec": np.repeat(forged_directions(1), 8, axis=2)}, "parallel"),
        ({"eigvec": np.full((6890, 3, 8), np.nan)}, "not numbers"),
        ({"eigvec": np.array([None])}, "array of object"),
    ],
)
def test_what_is_none_is_refused(tmp_path, fields, words):
    np.savez(tmp_path / "model.npz", **fields)
    with pytest.raises(DsnetError, match=words):
        load_dmpl_directions(tmp_path / "model.npz")


def test_no_file_and_half_a_file_are_refused(tmp_path):
    path = tmp_path / "model.npz"
    with pytest.raises(DsnetError, match="DMPL"):
        load_dmpl_directions(path)
    save_dmpl(path)
    path.write_bytes(path.read_bytes()[:100_000])
    with pytest.raises(DsnetError, match="DMPL"):
        load_dmpl_directions(path)
