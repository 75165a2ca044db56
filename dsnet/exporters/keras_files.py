"""The networks that Keras trained, as it saved them: `.keras`, or what is made from that."""

from __future__ import annotations

import shutil
from pathlib import Path

from bridge.errors import DsnetError
from bridge.exchange.dsnet import DSNETS
from dsnet.prediction.load_model import TrainedModel


def keras_file(trained: TrainedModel) -> Path:
    """The `.keras` file of a run's network; DsnetError where there is none."""
    network = f"{trained.name}.keras"
    train = trained.artifacts.get("train")
    if train is None:
        raise DsnetError(
            f"{trained.name} of {trained.owner} for Keras",
            "a network that it trained",
            f"Pass --run NAME --predictor {DSNETS[0]}.",
        )
    if network not in train.manifest["files"]:
        raise DsnetError(
            f"{train.path} without {network}",
            "a network saved by this version, of layers that Keras can save",
            f"Run `dsnet train --predictors {trained.name}` of that run.",
        )
    return train.file(network)


def write_keras(path: Path, saved: Path) -> None:
    """A copy."""
    shutil.copyfile(saved, path)
