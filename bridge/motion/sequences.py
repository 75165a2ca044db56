"""The sequence index: where each motion lies in arrays that hold all frames one after another."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

from bridge.runs.artifact import Artifact

Split = Literal["train", "validation", "test"]


@dataclass(frozen=True)
class MotionSequence:
    """One motion of one subject: frames `start` to `start + length` of the stage's arrays."""

    name: str
    """`<subject>_<motion>`, the data set's own key."""
    subject: str
    """Subject identifier, such as `50004`."""
    motion: str
    """Motion name, such as `one_leg_jump`."""
    start: int
    """First frame in the concatenated arrays."""
    length: int
    """Number of frames."""
    fps: float
    """Frames per second."""
    split: Split = "train"
    """What DSNet may do with it."""

    @property
    def frames(self) -> slice:
        """Slice of this sequence's frames along the first axis."""
        return slice(self.start, self.start + self.length)


def sequences_of(artifact: Artifact) -> list[MotionSequence]:
    """Read the sequence index of an artifact."""
    return [MotionSequence(**entry) for entry in artifact.manifest["sequences"]]


def to_manifest(sequences: Iterable[MotionSequence]) -> list[dict[str, Any]]:
    """The index as JSON values, for `ArtifactWriter.record(sequences=...)`."""
    return [asdict(sequence) for sequence in sequences]


def subjects_of(sequences: Iterable[MotionSequence]) -> list[str]:
    """Subjects in order of first appearance: row order of the `betas` arrays."""
    return list(dict.fromkeys(sequence.subject for sequence in sequences))


def subject_rows(sequences: Iterable[MotionSequence]) -> Mapping[str, int]:
    """Row of each subject in the `betas` array."""
    return {subject: row for row, subject in enumerate(subjects_of(sequences))}


def end_to_end(chosen: Sequence[MotionSequence]) -> list[MotionSequence]:
    """The same sequences with their places in arrays that hold just these, one after another."""
    placed, start = [], 0
    for sequence in chosen:
        placed.append(replace(sequence, start=start))
        start += sequence.length
    return placed
