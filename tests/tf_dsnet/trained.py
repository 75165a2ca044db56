"""A small run in which predictors were trained, for the tests of a module."""

from __future__ import annotations

from pathlib import Path

import pytest

from dsnet.stages import stage_train
from dsnet.stages.stage_train import TrainConfig
from tests.forged.encoded import write_encoded


def train_in(runs: Path, config: TrainConfig) -> Path:
    """Run `tiny` in that folder, trained without an interruption."""
    write_encoded(runs / "tiny" / "encode")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DSNET_RUNS", str(runs))
        stage_train.main(config)
    return runs / "tiny"
