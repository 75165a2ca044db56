"""Everything that evaluation compares: the trained predictors, and what learns nothing."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from bridge.measure.metrics import mean_offset_m
from bridge.motion import MotionSequence, sequences_of, subjects_of
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


class Predictions:
    """Offsets by name of predictor and sequence.

    Parameters
    ----------
    decode, align : artifacts of these stages.
    """

    def __init__(self, decode: Artifact, align: Artifact) -> None:
        trained: dict[str, str] = decode.manifest["predictors"]
        self.default: str = decode.manifest["default"]
        first = {self.default: trained[self.default]}
        self.labels: dict[str, str] = first | trained | LEARN_NOTHING
        self._trained, self._decode = set(trained), decode
        self._aligned = {sequence.name for sequence in sequences_of(align)}
        self._person_m, self._everybody_m = mean_offsets_m(align)

    def of(self, sequence: MotionSequence) -> list[str]:
        """Predictors of a sequence: only an aligned one has offsets to encode."""
        return [
            name for name in self.labels if name != AUTOENCODER or sequence.name in self._aligned
        ]

    def knows(self, subject: str) -> bool:
        """Whether the person was trained on."""
        return subject in self._person_m

    def offsets_m(self, predictor: str, sequence: MotionSequence, block: slice) -> NDArray:
        """(B, V, 3), or (1, V, 3) where they are constant; but for the sequence's own mean."""
        if predictor in self._trained or predictor == AUTOENCODER:
            frames = slice(sequence.start + block.start, sequence.start + block.stop)
            return self._decode.array(f"offsets_{predictor}")[frames]
        if predictor == PERSON_MEAN:
            return self._person_m.get(sequence.subject, self._everybody_m)[None]
        return np.zeros_like(self._everybody_m)[None]


def mean_offsets_m(
    align: Artifact,
) -> tuple[Mapping[str, NDArray[np.float64]], NDArray[np.float64]]:
    """Mean aligned offset (V, 3) of each person over the training frames, and of all people."""
    offsets_m = align.array("offsets")
    training = [sequence for sequence in sequences_of(align) if sequence.split == "train"]
    means = {}
    for subject in subjects_of(training):
        own = [sequence for sequence in training if sequence.subject == subject]
        sums = [sequence.length * mean_offset_m(offsets_m, sequence.frames) for sequence in own]
        means[subject] = np.sum(sums, axis=0) / sum(sequence.length for sequence in own)
    nobody = [np.zeros(offsets_m.shape[1:])]
    return means, np.mean(list(means.values()) or nobody, axis=0)
