"""Who is trained on what: sequences held out, the autoencoder's frames, what is evaluated."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.motion.sequences import MotionSequence, Split

SplitName = Literal["frame", "sequence"]
TRAIN_TENTHS = 7
_CHUNK_FRAMES = 128


@dataclass(frozen=True)
class FrameSplit:
    """Frame indices into the concatenated arrays, each in ascending order, disjoint."""

    train: NDArray[np.int64]
    validation: NDArray[np.int64]


def splits_of_names(names: Sequence[str], held_out: Collection[str]) -> dict[str, Split]:
    """Who is held out from all training: the sequences named, or the last if there is none."""
    chosen = set(held_out) & set(names) or set(names[1:][-1:])
    return {name: "validation" if name in chosen else "train" for name in names}


def split_autoencoder_frames(
    index: Sequence[MotionSequence], seed: int, *, by: SplitName, include_held_out: bool
) -> FrameSplit:
    """The autoencoder's 70 % and 30 % of the sequences that DSNet may be trained on.

    The paper draws from all frames, the validation sequence's too (`include_held_out`); then its
    code has seen the clip on which DSNet is judged.

    Raises
    ------
    DsnetError
        If too few frames or sequences are left.
    """
    known = [sequence for sequence in index if include_held_out or sequence.split == "train"]
    if by == "sequence":
        return split_sequences(known, seed)
    return split_frames(_frames(known, range(len(known))), seed)


def held_out_frames(index: Sequence[MotionSequence]) -> NDArray[np.int64]:
    """Frames of the sequences on which nothing but the paper's autoencoder is trained."""
    return _frames(index, [row for row, s in enumerate(index) if s.split != "train"])


def split_frames(frames: NDArray[np.int64], seed: int) -> FrameSplit:
    """Draw floor(0.7 n) frames at random, as the paper does: 15,051 and 6,451 of 21,502.

    Neighbouring frames of one clip fall on both sides, so its validation error
    is nearly a training error; `split_sequences` is stricter.

    Raises
    ------
    DsnetError
        If there are fewer than two frames.
    """
    if len(frames) < 2:
        raise DsnetError(
            f"{len(frames)} aligned frames to train on",
            "at least 2",
            "Align a longer sequence: dsnet align.",
        )
    order = np.random.default_rng(seed).permutation(frames)
    # In integers: 0.7 * n in floating point can fall just below a whole number.
    cut = len(frames) * TRAIN_TENTHS // 10
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


def _frames(index: Sequence[MotionSequence], rows: Iterable[int]) -> NDArray[np.int64]:
    chosen = (index[row].frames for row in sorted(rows))
    parts = [np.arange(part.start, part.stop) for part in chosen]
    return np.concatenate(parts) if parts else np.empty(0, np.int64)


def chunks(
    offsets_m: NDArray[np.float32], frames: NDArray[np.int64], size: int = _CHUNK_FRAMES
) -> Iterator[NDArray[np.float32]]:
    """Read the named frames of a memory-mapped (F, V, 3) array in pieces of `size`."""
    for start in range(0, len(frames), size):
        yield np.asarray(offsets_m[frames[start : start + size]], dtype=np.float32)
