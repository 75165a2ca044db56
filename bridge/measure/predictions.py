"""Everything that evaluation compares: the trained predictors, and what learns nothing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.measure.metrics import mean_offset_m
from bridge.measure.roads import Road
from bridge.motion import sequences_of
from bridge.runs import Artifact

AUTOENCODER, PERSON_MEAN, SEQUENCE_MEAN, SMPL = (
    "autoencoder",
    "person_mean",
    "sequence_mean",
    "smpl",
)
LEARN_NOTHING = {
    AUTOENCODER: "autoencoder alone, given the aligned offsets",
    PERSON_MEAN: "the person's mean offset over training",
    SEQUENCE_MEAN: "the sequence's own best constant (oracle)",
    SMPL: "SMPL alone",
}
"""Labels of what stands beside the trained predictors, in the order of the tables."""
_AGAIN = (PERSON_MEAN, SMPL)
CONSTANT = (PERSON_MEAN, SEQUENCE_MEAN, SMPL)
"""What does not move, and so has no velocity, spectrum or decay."""


@dataclass(frozen=True)
class Candidate:
    """One predictor, trained or not, on one road."""

    name: str
    """Its name in tables: that of the predictor; on a second road `<kind>_<road>`."""
    kind: str
    """The trained predictor's name, or one of `LEARN_NOTHING`."""
    label: str
    """For people."""
    road: Road
    """Whose motions and alignment it is measured with."""

    @property
    def moves(self) -> bool:
        """Whether its offsets change over time."""
        return self.kind not in CONSTANT


def candidates(roads: Sequence[Road]) -> dict[str, Candidate]:
    """All that is compared, in the order of the tables: the last road's predictors first."""
    found = [
        Candidate(name, name, label, road)
        for road in reversed(roads)
        for name, label in road.predictors.items()
    ]
    first = roads[0]
    for kind, label in LEARN_NOTHING.items():
        if kind != AUTOENCODER or f"offsets_{AUTOENCODER}" in first.offsets.manifest["arrays"]:
            found.append(Candidate(kind, kind, label, first))
    for road in roads[1:]:
        # What learns nothing differs only by what alignment made of shape, pose and offsets.
        if road.align.content_sha256 != first.align.content_sha256:
            found += [
                Candidate(
                    f"{kind}_{road.name}",
                    kind,
                    f"{LEARN_NOTHING[kind]}, on the {road.name} road",
                    road,
                )
                for kind in _AGAIN
            ]
    return {one.name: one for one in found}


class Predictions:
    """Offsets of one road by kind of predictor and sequence."""

    def __init__(self, road: Road) -> None:
        self._road, self._places, self._aligned = road, road.sequences, road.aligned
        self._person_m, self._everybody_m = mean_offsets_m(road.align)

    def has(self, kind: str, sequence: str) -> bool:
        """Whether there are offsets of a sequence: only an aligned one has some to encode."""
        return sequence in self._places and (kind != AUTOENCODER or sequence in self._aligned)

    def length(self, sequence: str) -> int:
        """Frames of a sequence."""
        return self._places[sequence].length

    def person(self, sequence: str) -> str:
        """Whose motion a sequence is."""
        return self._places[sequence].subject

    def offsets_m(
        self, kind: str, sequence: str, frames: slice, vertices: slice = slice(None)
    ) -> NDArray:
        """(B, V, 3), or (1, V, 3) where they are constant; but for the sequence's own mean."""
        if kind == PERSON_MEAN:
            return self._person_m.get(self.person(sequence), self._everybody_m)[None, vertices]
        if kind == SMPL:
            return np.zeros_like(self._everybody_m)[None, vertices]
        return self._rows(f"offsets_{kind}", sequence, frames, vertices)

    def static_m(
        self, kind: str, sequence: str, frames: slice, vertices: slice = slice(None)
    ) -> NDArray | None:
        """(B, V, 3) the static part of the offsets, None of a predictor that tells none."""
        if f"static_{kind}" not in self._road.offsets.manifest["arrays"]:
            return None
        return self._rows(f"static_{kind}", sequence, frames, vertices)

    def aligned_m(self, sequence: str, frames: slice, vertices: slice = slice(None)) -> NDArray:
        """(B, V, 3) aligned offsets of an aligned sequence."""
        start = self._aligned[sequence].start
        offsets_m = self._road.align.array("offsets")
        return offsets_m[start + frames.start : start + frames.stop, vertices]

    def _rows(self, array: str, sequence: str, frames: slice, vertices: slice) -> NDArray:
        start = self._places[sequence].start
        rows = slice(start + frames.start, start + frames.stop)
        return self._road.offsets.array(array)[rows, vertices]


def mean_offsets_m(
    align: Artifact,
) -> tuple[Mapping[str, NDArray[np.float64]], NDArray[np.float64]]:
    """Mean aligned offset (V, 3) of each person over the training frames, and of all people."""
    offsets_m = align.array("offsets")
    sums_m: dict[str, NDArray[np.float64]] = {}
    frames = Counter[str]()
    for sequence in sequences_of(align):
        if sequence.split == "train":
            own_m = sequence.length * mean_offset_m(offsets_m, sequence.frames)
            before_m = sums_m.get(sequence.subject)
            sums_m[sequence.subject] = own_m if before_m is None else before_m + own_m
            frames[sequence.subject] += sequence.length
    means = {subject: sum_m / frames[subject] for subject, sum_m in sums_m.items()}
    nobody = [np.zeros(offsets_m.shape[1:])]
    return means, np.mean(list(means.values()) or nobody, axis=0)
