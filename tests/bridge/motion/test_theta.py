"""The 69-vector: packing and unpacking are inverse; and the sequences of a run."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge import DsnetError
from bridge.motion import MotionSequence, pack_theta, unpack_theta


@given(st.integers(0, 5), st.integers(22, 24), st.integers(0, 2**32 - 1))
def test_unpack_inverts_pack(frames, joints, seed):
    rng = np.random.default_rng(seed)
    pose, trans = rng.normal(size=(frames, joints, 3)), rng.normal(size=(frames, 3))
    theta = pack_theta(pose, trans)
    assert theta.shape == (frames, 69)
    back = unpack_theta(theta)
    np.testing.assert_array_equal(back[0], pose[:, :22])
    np.testing.assert_array_equal(back[1], trans)


def test_root_comes_first_and_translation_last():
    theta = np.arange(69.0)
    pose, trans = unpack_theta(theta)
    np.testing.assert_array_equal(pose[0], [0, 1, 2])
    np.testing.assert_array_equal(trans, [66, 67, 68])


@pytest.mark.parametrize("shape", [(21, 3), (22, 4), (3, 21, 3)])
def test_pack_refuses_other_shapes(shape):
    with pytest.raises(DsnetError, match="22 or more"):
        pack_theta(np.zeros(shape), np.zeros((*shape[:-2], 3)))


def test_unpack_refuses_smpls_own_72():
    with pytest.raises(DsnetError, match="69"):
        unpack_theta(np.zeros((2, 72)))


@pytest.mark.parametrize("length", [1, 4, 5, 8, 9])
def test_pieces_are_all_frames_in_order(length: int) -> None:
    sequence = MotionSequence("a_b", "a", "b", 7, length, 60.0)
    pieces = list(sequence.pieces(4))
    assert [row for piece in pieces for row in range(piece.start, piece.stop)] == list(
        range(7, 7 + length)
    )
    assert all(0 < piece.stop - piece.start <= 4 for piece in pieces)


def test_a_usual_sequence_is_one_piece() -> None:
    sequence = MotionSequence("a_b", "a", "b", 7, 900, 60.0)
    assert list(sequence.pieces()) == [sequence.frames]
