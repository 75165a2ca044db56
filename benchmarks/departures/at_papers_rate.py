"""The standardised DSNet at the paper's rate."""

from __future__ import annotations

from dataclasses import dataclass

from bridge.exchange.train_options import PredictorSettings
from tf_dsnet.predictors import PAPER_LR, DsnetPredictor


@dataclass(frozen=True)
class AtPapersRate(DsnetPredictor):
    """Learns at 1e-4 whatever the run says."""

    name: str = "dsnet_standardised_1e-4"
    label: str = "DSNet, standardised, 1e-4"

    def lr(self, settings: PredictorSettings) -> float:
        """The paper's."""
        del settings
        return PAPER_LR
