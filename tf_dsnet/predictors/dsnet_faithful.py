"""`dsnet_faithful`: raw motions in, latents out as the autoencoder gives them (Section 5)."""

from __future__ import annotations

from dataclasses import dataclass

from bridge.exchange.trained_dsnet import Scaling
from tf_dsnet.predictors.base import PredictorSettings, TrainingData
from tf_dsnet.predictors.dsnet import DsnetPredictor


@dataclass(frozen=True)
class FaithfulDsnet(DsnetPredictor):
    """The paper's words and nothing else."""

    name: str = "dsnet_faithful"
    label: str = "DSNet, faithful"
    preset: str = "faithful"

    def lr(self, settings: PredictorSettings) -> float:
        """Adam's learning rate."""
        return settings.lr_faithful

    def scaling(self, settings: PredictorSettings, data: TrainingData) -> Scaling:
        """Nothing is scaled."""
        return Scaling.identity()
