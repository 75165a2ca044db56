"""The sequence index: where each motion lies in arrays that hold all frames one after another."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.motion.readers import READERS
from bridge.runs.artifact import Artifact

FRAMES_AT_ONCE = 1024
"""Of a long sequence: 85 MB of meshes."""
_MOST_FRAMES = 2**40
Split = Literal["train", "validation", "test"]


@dataclass(frozen=True)
class MotionSequence:
    """One motion of one subject: frames `start` to `start + length` of the stage's arrays."""

    name: str
    """`<subject>_<motion>`, the data set's key."""
    subject: str
    """Such as `50004`."""
    motion: str
    """Such as `one_leg_jump`."""
    start: int
    length: int
    fps: float
    split: Split = "train"
    """What DSNet may do with it."""

    @property
    def frames(self) -> slice:
        """Its frames along the first axis."""
        return slice(self.start, self.start + self.length)

    def pieces(self, size: int = FRAMES_AT_ONCE) -> Iterator[slice]:
        """The same in slices whose meshes fit in memory; most sequences are one."""
        stop = self.start + self.length
        for start in range(self.start, stop, size):
            yield slice(start, min(start + size, stop))


def is_real_motion(name: str) -> bool:
    """Whether a synthetic corpus's sequence `<subject>_<motion>` has a motion of real people."""
    return name.partition("_")[2].startswith(tuple(f"{reader}_" for reader in READERS))


def sequences_of(artifact: Artifact) -> list[MotionSequence]:
    """Read the sequence index of an artifact; `DsnetError` if it has none, or one that is none."""
    try:
        sequences = [MotionSequence(**entry) for entry in artifact.manifest["sequences"]]
    except TypeError:
        sequences = None
    if sequences is None or not all(map(_is_one, sequences)):
        raise DsnetError(
            f"{artifact.path}, whose manifest has no list of sequences",
            "names, first frames, lengths and rates",
            "Delete the folder and run its stage again.",
        )
    return sequences


def _is_one(sequence: MotionSequence) -> bool:
    names = (sequence.name, sequence.subject, sequence.motion, sequence.split)
    places = (sequence.start, sequence.length)
    return (
        all(isinstance(name, str) for name in names)
        and all(type(place) is int and 0 <= place < _MOST_FRAMES for place in places)
        and isinstance(sequence.fps, (int, float))
        and 0 < sequence.fps < float("inf")
    )


def to_manifest(sequences: Iterable[MotionSequence]) -> list[dict[str, Any]]:
    """The index as JSON values, for `ArtifactWriter.record(sequences=...)`."""
    return [asdict(sequence) for sequence in sequences]


def subjects_of(sequences: Iterable[MotionSequence]) -> list[str]:
    """Subjects in order of first appearance: row order of the `betas` arrays."""
    return list(dict.fromkeys(sequence.subject for sequence in sequences))


def subject_rows(sequences: Iterable[MotionSequence]) -> Mapping[str, int]:
    """Row of each subject in the `betas` array."""
    return {subject: row for row, subject in enumerate(subjects_of(sequences))}


def shape_rows(
    sequences: Sequence[MotionSequence], betas: NDArray[np.floating]
) -> Mapping[str, int]:
    """Row of each sequence, by name, in `betas` (rows, 10): its subject's, or its own where every
    sequence has a shape (`dsnet align --betas-per sequence`)."""
    if len(betas) == len(sequences):
        return {sequence.name: row for row, sequence in enumerate(sequences)}
    rows = subject_rows(sequences)
    return {sequence.name: rows[sequence.subject] for sequence in sequences}


def subject_shapes(
    sequences: Sequence[MotionSequence], betas: NDArray[np.floating]
) -> dict[str, NDArray[np.floating]]:
    """Betas (10,) of each subject; the mean of its sequences' where each has its own."""
    rows = shape_rows(sequences, betas)
    of_subject: dict[str, list[int]] = {subject: [] for subject in subjects_of(sequences)}
    for sequence in sequences:
        of_subject[sequence.subject].append(rows[sequence.name])
    return {subject: betas[sorted(set(own))].mean(0) for subject, own in of_subject.items()}


def end_to_end(chosen: Sequence[MotionSequence]) -> list[MotionSequence]:
    """The same sequences with their places in arrays that hold just these, one after another."""
    placed, start = [], 0
    for sequence in chosen:
        placed.append(replace(sequence, start=start))
        start += sequence.length
    return placed
