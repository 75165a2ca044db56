"""DSNet told how poses change in place of poses, which are new in new motions.

The paper gives DSNet betas and theta (Section 5), 79 numbers. Where the pose is new to it such a
network is lost, for it has learned the places of motions with them (docs/findings.md); how a pose
changes is what loads tissue, wherever it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from numpy.typing import NDArray

from benchmarks.systems.kinematics import DIFFERENCES_SIZE, pose_differences
from bridge.exchange.dsnet import TrainedDsnet, join_inputs
from bridge.exchange.train_options import PredictorSettings
from tf_dsnet.predictors import (
    BodyOf,
    DsnetPredictor,
    PredictMotion,
    TrainingData,
    applied_dsnet,
)
from tf_dsnet.trainer import DsnetTraining


@dataclass(frozen=True)
class DifferencesDsnet(DsnetPredictor):
    """The standardised network on betas and theta's first and second differences."""

    name: str = "dsnet_differences"
    label: str = "DSNet, pose differences"

    def departures(self, settings: PredictorSettings) -> tuple[str, ...]:
        """Where it leaves the paper."""
        told = f"{DIFFERENCES_SIZE} inputs: betas and theta's first and second differences"
        return (told, *super().departures(settings))

    def training(
        self, settings: PredictorSettings, data: TrainingData, checkpoint: Path
    ) -> DsnetTraining:
        """Begin training, or go on from `checkpoint` if that file is there."""
        train, validation = (
            [replace(clip, inputs=pose_differences(clip.inputs)) for clip in part]
            for part in (data.train, data.validation)
        )
        told = replace(data, train=train, validation=validation)
        return super().training(settings, told, checkpoint)

    def load(self, arrays: Mapping[str, NDArray], body: BodyOf) -> PredictMotion:
        """A trained network, applied to whole motions."""
        latents_of = applied_dsnet(TrainedDsnet.from_arrays(self.name, arrays))
        return lambda theta, betas: latents_of(pose_differences(join_inputs(theta, betas)))
