"""Where sequences lie."""

from __future__ import annotations

import pytest

from bridge.motion import MotionSequence


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
