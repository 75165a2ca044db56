"""Which frames train the autoencoder and which ones validate it (Section 5: 70 % and 30 %)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.motion.sequences import MotionSequence

SplitName = Literal["frame", "sequence"]
TRAIN_TENTHS = 7
_CHUNK_FRAMES = 128


@dataclass(frozen=True)
class FrameSplit:
    """Frame indices into the concatenated arrays, each in ascending order, disjoint."""

    train: NDArray[np.int64]
    validation: NDArray[np.int64]


def split_frames(count: int, seed: int) -> FrameSplit:
    """Draw floor(0.7 n) frames at random, as the paper does: 15,051 and 6,451 of 21,502.

    Neighbouring frames of one clip fall on both sides, so its validation error
    is nearly a training error; `split_sequences` is the stricter reading.

    Raises
    ------
    DsnetError
        If there are fewer than two frames.
    """
    if count < 2:
        raise DsnetError(
            f"{count} aligned frames", "at least 2", "Align a longer sequence: dsnet align."
        )
    order = np.random.default_rng(seed).permutation(count)
    # In integers: 0.7 * n in floating point can fall just below a whole number.
    cut = count * TRAIN_TENTHS // 10
    return FrameSplit(np.sort(order[:cut]), np.sort(order[cut:]))


def split_sequences(index: Sequence[MotionSequence], seed: int) -> FrameSplit:
    """Draw floor(0.7 S) whole sequences at random, so that no clip lies on both sides.

    Raises
    ------
    DsnetError
        If there are fewer than two sequences.
    """
    if len(index) < 2:
        raise DsnetError(
            f"{len(index)} aligned sequences", "at least 2", "Use the frame-level split."
        )
    order = np.random.default_rng(seed).permutation(len(index))
    cut = len(index) * TRAIN_TENTHS // 10
    return FrameSplit(_frames(index, order[:cut]), _frames(index, order[cut:]))


def decoded_sequences(index: Iterable[MotionSequence]) -> list[MotionSequence]:
    """Validation and test sequences, and the first training sequence of each subject."""
    chosen, represented = [], set()
    for sequence in index:
        if sequence.split == "train":
            if sequence.subject in represented:
                continue
            represented.add(sequence.subject)
        chosen.append(sequence)
    return chosen


def _frames(index: Sequence[MotionSequence], rows: NDArray[np.int64]) -> NDArray[np.int64]:
    chosen = (index[row].frames for row in sorted(rows))
    return np.concatenate([np.arange(part.start, part.stop) for part in chosen])


def chunks(
    offsets_m: NDArray[np.float32], frames: NDArray[np.int64], size: int = _CHUNK_FRAMES
) -> Iterator[NDArray[np.float32]]:
    """Read the named frames of a memory-mapped (F, V, 3) array in pieces of `size`."""
    for start in range(0, len(frames), size):
        yield np.asarray(offsets_m[frames[start : start + size]], dtype=np.float32)
