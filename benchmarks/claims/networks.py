"""`python -m benchmarks.claims.networks --out DIR`: DSNet and its rivals on what a run aligned.

For every seed: each system's error in every test group, how fast it converged, what it loses with
somebody else's betas or a shorter history, and what its layers hold of the joints' rates.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from benchmarks.claims.by_the_paper import ByThePaper, keras_decoder
from benchmarks.claims.data import VALIDATION, ComponentsData, PapersData, StudyData
from benchmarks.claims.looked_into import by_cell, exchanged, inside
from benchmarks.claims.references import InComponents, ScoredMotion, r2
from benchmarks.plugin import predictors
from benchmarks.prediction.corpora import check_names
from benchmarks.processes import run_as_process
from benchmarks.systems.dsnet_variants import DsnetVariant
from bridge.body import load_body_model
from bridge.exchange.train_options import PredictorSettings
from bridge.runs import Run
from bridge.runs.files import write_text_atomically
from bridge.runs.run import body_model_path
from tf_dsnet.predictors import Predictor, TrainingData

Reading = Literal["fair", "paper"]
FILES: dict[Reading, str] = {"fair": "align_robust", "paper": "paper"}
"""What a file of results is called, before its seed."""
DSNET = "dsnet_pca"
"""The paper's network, the one whose history and layers are looked into."""
SYSTEMS = (
    DSNET, "dsnet_no_batch_norm", "dsnet_two_frames", "dsnet_rbf", "dsnet_two_lstm",
    "dsnet_three_lstm", "dyna_like", "casas_otaduy_like",
)  # fmt: skip
_COMPONENTS = (8, 25, 100)
_VALIDATE_EVERY = 10


@dataclass(frozen=True)
class NetworksConfig:
    """Train and score; what a file has of the same data is kept, so that a killed study goes on."""

    out: Path
    """Folder that receives <align_robust or paper>-<seed>.json."""
    run: str = "demo"
    """Run of both pipelines, evaluated."""
    reading: Reading = "fair"
    """fair: principal components of the robust aligner's offsets, with rate and epoch chosen for
    each network. paper: the latents of the run's autoencoder of what the paper's aligner gives,
    nothing scaled, Adam's rate 0.0001, the last epoch; rivals, of whose training the paper says
    nothing, learn these latents with rate and epoch chosen."""
    seeds: tuple[int, ...] = (0,)
    """Training seeds."""
    systems: tuple[str, ...] = SYSTEMS
    """Which to train; dsnet_pca always, as the others are DSNet with one change or rivals."""
    epochs: int = 500
    """Of each, its search for a rate included."""


def main(config: NetworksConfig) -> None:
    """Write what is missing."""
    check_names(config.systems, tuple(predictors()), "systems")
    run = Run(config.run)
    fair = config.reading == "fair"
    data = ComponentsData(run) if fair else PapersData(run, keras_decoder)
    body = load_body_model(str(body_model_path(run)))
    training = TrainingData(data.clips("train"), data.clips(VALIDATION), lambda: body)
    config.out.mkdir(parents=True, exist_ok=True)
    for seed in config.seeds:
        path = config.out / f"{FILES[config.reading]}-{seed}.json"
        kept = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        same = {"epochs": config.epochs, **data.identity()}
        if any(kept.get(name, value) != value for name, value in same.items()):
            kept = {}
        _study(config, data, training, seed, kept | same, path)


def _study(
    config: NetworksConfig,
    data: StudyData,
    training: TrainingData,
    seed: int,
    found: dict[str, Any],
    path: Path,
) -> None:
    """Train what is missing and write the file after each system."""
    systems: dict[str, Any] = found.setdefault("systems", {})
    found |= {
        "command": " ".join(["python", "-m", "benchmarks.claims.networks", *sys.argv[1:]]),
        "run": config.run,
        "reading": config.reading,
        "seed": seed,
    }
    if config.reading == "fair":
        found["components_r2"] = _components(data.tested)
    entries = _entries(config.reading)
    for name in dict.fromkeys((DSNET, *config.systems)):
        if name in systems:
            continue
        print(f"{name}, seed {seed}", flush=True)
        entry = entries[name]
        settings = PredictorSettings(epochs=config.epochs, seed=seed)
        described, arrays = _trained(entry, settings, training)
        predict = entry.load(arrays, training.body)
        if name == DSNET:
            variant = predictors()[DSNET]
            assert isinstance(variant, DsnetVariant)
            found["exchanged_betas"] = exchanged(predict, data.tested)
            found |= inside(variant, arrays, training, data.tested)
        systems[name] = described | {"r2": by_cell(predict, data.tested)}
        write_text_atomically(path, json.dumps(found, indent=1, allow_nan=False) + "\n")


def _entries(reading: Reading) -> Mapping[str, Predictor]:
    """By name: in the paper's reading the variants of DSNet are trained by its words."""
    return {
        name: ByThePaper(entry) if reading == "paper" and isinstance(entry, DsnetVariant) else entry
        for name, entry in predictors().items()
    }


def _trained(
    entry: Predictor, settings: PredictorSettings, data: TrainingData
) -> tuple[dict[str, Any], dict[str, NDArray]]:
    """What is told of a training, and its weights."""
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        training = entry.training(settings, data, Path(folder) / "checkpoint")
        for epoch in range(settings.epochs):
            last = epoch + 1 == settings.epochs
            training.epoch(epoch, validate=last or (epoch + 1) % _VALIDATE_EVERY == 0)
        described = {
            "label": entry.label,
            "parameters": next(iter(training.parameters().values())),
            "rate": training.lr,
            "train_s": round(time.perf_counter() - started, 1),
            "loss": [round(float(loss), 3) for loss in training.losses],
            "validation_loss": [round(float(loss), 3) for loss in training.validation_losses],
        }
        return described, training.arrays()


def _components(tested: Sequence[ScoredMotion]) -> dict[str, float]:
    """R2 of the held-out clip's offsets in the leading components."""
    held_out = [one.reference for one in tested if one.cell == VALIDATION]
    own = [one for one in held_out if isinstance(one, InComponents)]
    return {
        str(size): round(
            r2(
                np.concatenate(
                    [one.left_out + np.square(one.codes[:, size:]).sum(axis=1) for one in own]
                ),
                np.concatenate([one.squares for one in own]),
            ),
            5,
        )
        for size in _COMPONENTS
    }


if __name__ == "__main__":
    run_as_process(NetworksConfig, main)
