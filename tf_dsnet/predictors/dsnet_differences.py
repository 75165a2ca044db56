"""`dsnet_differences`: told how poses change in place of poses, which are new in new motions."""

from __future__ import annotations

from dataclasses import dataclass

from bridge.exchange.input_kinds import DIFFERENCES, InputKind
from tf_dsnet.predictors.base import PredictorSettings
from tf_dsnet.predictors.dsnet_standardised import StandardisedDsnet


@dataclass(frozen=True)
class DifferencesDsnet(StandardisedDsnet):
    """The standardised network on betas and theta's first and second differences."""

    name: str = "dsnet_differences"
    label: str = "DSNet, pose differences"
    preset: str = "differences"

    @property
    def input_kind(self) -> InputKind:
        """No pose itself."""
        return DIFFERENCES

    def departures(self, settings: PredictorSettings) -> tuple[str, ...]:
        """Where it leaves the paper."""
        told = f"{DIFFERENCES.size} inputs: betas and theta's first and second differences"
        return (told, *super().departures(settings))
