"""What the figures draw: a run's stages, its roads, its body, and posed frames of its sequences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData, pose_vertices
from bridge.measure.predictions import AUTOENCODER
from bridge.measure.roads import PAPER, Road, road_of, roads_of
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
    panel_px: int = 300
    """Height of one rendered body."""

    @property
    def origin(self) -> DataOrigin:
        """`synthetic` or `licensed`."""
        return self.stages["evaluate"].origin

    @cached_property
    def roads(self) -> list[Road]:
        """The run's roads, the paper's first."""
        return roads_of(self.stages)

    @property
    def follows_paper(self) -> bool:
        """Whether the run went the paper's road."""
        return any(road.name == PAPER for road in self.roads)

    @property
    def shown(self) -> dict[str, str]:
        """Predictors that are drawn, one a road, with their labels."""
        return {road.default: road.predictors[road.default] for road in self.roads}

    def validation(self) -> MotionSequence | None:
        """The paper's validation sequence, or the run's first; None if it has none."""
        result = validation_result(self.stages["evaluate"])
        return None if result is None else self.decoded()[result["name"]]

    def decoded(self) -> dict[str, MotionSequence]:
        """Sequences that every road has predicted, by name."""
        first, *others = (road.sequences for road in self.roads)
        return {name: s for name, s in first.items() if all(name in other for other in others)}

    def aligned_offsets_m(
        self, road: Road, name: str, frames: NDArray[np.int64]
    ) -> NDArray[np.float32]:
        """(N, V, 3) a road's aligned offsets of a sequence, its frames counted from 0."""
        return road.align.array("offsets")[road.aligned[name].start + frames]

    def offsets_m(
        self, predictor: str, name: str, frames: NDArray[np.int64]
    ) -> NDArray[np.float32]:
        """(N, V, 3) offsets that a predictor, or the autoencoder, gives for a sequence."""
        road = self.roads[0] if predictor == AUTOENCODER else road_of(self.roads, predictor)
        return road.offsets.array(f"offsets_{predictor}")[road.sequences[name].start + frames]

    def pose(
        self, road: Road, name: str, frames: NDArray[np.int64], offsets_m: NDArray | None
    ) -> NDArray[np.float64]:
        """(N, V, 3) bodies in a road's motion, without their travel along the floor."""
        sequences = sequences_of(road.motions)
        place = next(s for s in sequences if s.name == name)
        betas = road.motions.array("betas")[subject_rows(sequences)[place.subject]]
        pose, trans = unpack_theta(road.motions.array("theta")[place.start + frames])
        travel = trans * [1.0, 0.0, 1.0]
        shapes = np.repeat(betas[None], len(frames), axis=0)
        return pose_vertices(self.body, shapes, pose, trans - travel, offsets_m)
