"""What the figures draw: a run's stages, its body, and posed frames of its sequences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData, pose_vertices
from bridge.motion import MotionSequence, sequences_of, subject_rows, unpack_theta
from bridge.report.measured import validation_result
from bridge.runs import Artifact
from bridge.runs.artifact import DataOrigin


@dataclass(frozen=True)
class Scene:
    """Everything that a figure needs."""

    stages: Mapping[str, Artifact]
    """Artifacts by stage."""
    body: BodyModelData
    """The body that the run was aligned with."""
    samples: int = 16
    """Light paths a pixel."""
    panel_px: int = 300
    """Height of one rendered body."""

    @property
    def origin(self) -> DataOrigin:
        """`synthetic` or `licensed`."""
        return self.stages["align"].origin

    @property
    def default(self) -> str:
        """Name of the predictor that is drawn."""
        return self.stages["decode"].manifest["default"]

    def validation(self) -> MotionSequence | None:
        """The paper's validation sequence as `decode` numbers its frames, or the run's first."""
        result = validation_result(self.stages["evaluate"])
        return None if result is None else self.decoded()[result["name"]]

    def decoded(self) -> dict[str, MotionSequence]:
        """Sequences of the `decode` stage by name."""
        return {sequence.name: sequence for sequence in sequences_of(self.stages["decode"])}

    def aligned_offsets_m(self, name: str, frames: NDArray[np.int64]) -> NDArray[np.float32]:
        """(N, V, 3) aligned offsets of a sequence, its frames counted from 0."""
        align = self.stages["align"]
        place = next(s for s in sequences_of(align) if s.name == name)
        return align.array("offsets")[place.start + frames]

    def decoded_offsets_m(
        self, predictor: str, name: str, frames: NDArray[np.int64]
    ) -> NDArray[np.float32]:
        """(N, V, 3) offsets that a predictor, or the autoencoder, gives for a sequence."""
        offsets_m = self.stages["decode"].array(f"offsets_{predictor}")
        return offsets_m[self.decoded()[name].start + frames]

    def pose(
        self, name: str, frames: NDArray[np.int64], offsets_m: NDArray | None
    ) -> NDArray[np.float64]:
        """(N, V, 3) posed bodies, without their travel along the floor."""
        predict = self.stages["predict"]
        sequences = sequences_of(predict)
        place = next(s for s in sequences if s.name == name)
        betas = predict.array("betas")[subject_rows(sequences)[place.subject]]
        pose, trans = unpack_theta(predict.array("theta")[place.start + frames])
        travel = trans * [1.0, 0.0, 1.0]
        shapes = np.repeat(betas[None], len(frames), axis=0)
        return pose_vertices(self.body, shapes, pose, trans - travel, offsets_m)
