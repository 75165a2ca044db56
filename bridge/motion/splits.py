"""Who is trained on what: sequences held out, the autoencoder's frames, the four test groups."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.motion.sequences import MotionSequence, Split, is_real_motion

SplitName = Literal["frame", "sequence"]
TRAIN_TENTHS = 7
CELLS = {
    "known_person_known_motion": "known person, known motion",
    "known_person_unseen_motion": "known person, unseen motion",
    "new_person_known_motion": "new person, known motion",
    "new_person_unseen_motion": "new person, unseen motion",
}
"""Label of each group of test motions (Figure 9), from the easiest to the hardest."""
_CHUNK_FRAMES = 128
_TAKE = re.compile(r"_take\d+$|_bugfix$")
_NUMBER = re.compile(r"(?<=[a-z])_?\d+$")


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
    code has seen the clip on which DSNet is judged. By sequence, no clip lies on both sides.
    """
    known = [sequence for sequence in index if include_held_out or sequence.split == "train"]
    if by == "frame":
        return split_frames(_frames(known), seed)
    if len(known) < 2:
        raise DsnetError(
            f"{len(known)} aligned sequences", "at least 2", "Use the frame-level split."
        )
    rows = split_frames(np.arange(len(known)), seed)
    sides = ([known[row] for row in side] for side in (rows.train, rows.validation))
    return FrameSplit(*map(_frames, sides))


def held_out_frames(index: Sequence[MotionSequence]) -> NDArray[np.int64]:
    """Frames of the sequences on which nothing but the paper's autoencoder is trained."""
    return _frames([sequence for sequence in index if sequence.split != "train"])


def split_frames(frames: NDArray[np.int64], seed: int) -> FrameSplit:
    """Draw floor(0.7 n) frames at random, as the paper does: 15,051 and 6,451 of 21,502.

    Neighbouring frames of one clip fall on both sides, so its validation error
    is nearly a training error; a split by sequence is stricter.
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


def _frames(sequences: Iterable[MotionSequence]) -> NDArray[np.int64]:
    parts = [np.arange(one.frames.start, one.frames.stop) for one in sequences]
    return np.concatenate(parts) if parts else np.empty(0, np.int64)


def chunks(
    offsets_m: NDArray[np.float32], frames: NDArray[np.int64], size: int = _CHUNK_FRAMES
) -> Iterator[NDArray[np.float32]]:
    """Read the named frames of a memory-mapped (F, V, 3) array in pieces of `size`."""
    for start in range(0, len(frames), size):
        yield np.asarray(offsets_m[frames[start : start + size]], dtype=np.float32)


def decoded_sequences(index: Sequence[MotionSequence]) -> list[MotionSequence]:
    """Validation and test sequences, and the first training sequence of each subject."""
    first = {one.subject: one for one in reversed(index) if one.split == "train"}
    return [one for one in index if one.split != "train" or one is first[one.subject]]


def take_suffix(take: int) -> str:
    """What the name of a motion ends with when the same person does it again."""
    return f"_take{take}"


def kind_of(motion: str) -> str:
    """The kind of a motion: its name without what tells one take from another.

    Dyna's `running_on_spot_bugfix` is `running_on_spot`, MoSh's `simple_crouch2` and
    `simple_crouch_3` are `simple_crouch`; a real motion in a synthetic corpus is a kind of its own.
    """
    kind = _TAKE.sub("", motion)
    return kind if is_real_motion(f"_{kind}") else _NUMBER.sub("", kind)


def trained_people_and_kinds(sequences: Iterable[MotionSequence]) -> tuple[set[str], set[str]]:
    """Subjects and kinds of motion of the sequences that training sees."""
    trained = [sequence for sequence in sequences if sequence.split == "train"]
    return {s.subject for s in trained}, {kind_of(s.motion) for s in trained}


def cell_of(
    sequence: MotionSequence, known_people: Collection[str], known_kinds: Collection[str]
) -> str:
    """The group of a test sequence, given whom and which kinds training has seen."""
    person = "known" if sequence.subject in known_people else "new"
    motion = "known" if kind_of(sequence.motion) in known_kinds else "unseen"
    return f"{person}_person_{motion}_motion"
