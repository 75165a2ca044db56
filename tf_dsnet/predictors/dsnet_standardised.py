"""`dsnet_standardised`: inputs and latents scaled, which decides how fast Adam learns."""

from __future__ import annotations

from dataclasses import dataclass

from bridge.exchange.clips import fit_scaling
from bridge.exchange.trained_dsnet import Scaling
from tf_dsnet.predictors.base import PredictorSettings, TrainingData
from tf_dsnet.predictors.dsnet import DsnetPredictor


@dataclass(frozen=True)
class StandardisedDsnet(DsnetPredictor):
    """Departs from the paper, which is silent about the scale."""

    name: str = "dsnet_standardised"
    label: str = "DSNet, standardised"
    preset: str = "standardised"

    def lr(self, settings: PredictorSettings) -> float:
        """Adam's learning rate."""
        return settings.lr_standardised

    def departures(self, settings: PredictorSettings) -> tuple[str, ...]:
        """Where it leaves the paper."""
        scaled = "inputs and latents are standardised over the training frames"
        return (scaled, *super().departures(settings))

    def scaling(self, settings: PredictorSettings, data: TrainingData) -> Scaling:
        """Mean and spread of the training frames."""
        return fit_scaling(data.train, settings.min_input_std)
