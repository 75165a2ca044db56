"""`python -m benchmarks.claims.seconds --out FILE`: what DSNet and a SoftSMPL-like network cost.

Both are trained as the comparison does, on random motions of the size of the paper's data, turn by
turn: processor seconds, which other work on the machine hardly changes, of an epoch with its
validation, of what comes before the first one (SoftSMPL learns a code of poses), and of a frame of
a whole motion.
"""

from __future__ import annotations

import json
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.plugin import predictors
from benchmarks.processes import run_as_process
from benchmarks.speed.dsnet import FRAMES, SEQUENCES
from bridge.body import load_body_model
from bridge.exchange.dsnet import UnpaddedClip
from bridge.exchange.train_options import PredictorSettings
from bridge.paper import INPUT_SIZE, LATENT_SIZE, N_BETAS
from bridge.runs.files import write_text_atomically
from tf_dsnet.predictors import PredictorTraining, TrainingData

SYSTEMS = ("dsnet_pca", "softsmpl_like")
_WARM_UPS = 2


@dataclass(frozen=True)
class SecondsConfig:
    """Time both networks; takes a minute or two."""

    out: Path
    """JSON file to write."""
    sequences: int = SEQUENCES
    """Clips of an epoch."""
    epochs: int = 10
    """Epochs and motions to time, after two that are not."""


def main(config: SecondsConfig) -> None:
    """Write the results."""
    data = _random_data(config.sequences)
    results = {
        "command": " ".join(["python", "-m", "benchmarks.claims.seconds", *sys.argv[1:]]),
        "sequences": config.sequences,
        "cores": os.cpu_count(),
        "systems": timed(data, config.epochs),
    }
    config.out.parent.mkdir(parents=True, exist_ok=True)
    write_text_atomically(config.out, json.dumps(results, indent=1, allow_nan=False) + "\n")


def timed(data: TrainingData, turns: int) -> dict[str, dict[str, float]]:
    """By system, processor time: seconds before the first epoch and of one, and of a frame."""
    settings = PredictorSettings(epochs=_WARM_UPS + turns)
    trainings: dict[str, PredictorTraining] = {}
    found: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in SYSTEMS:
            started = time.process_time()
            trainings[name] = predictors()[name].training(settings, data, Path(folder) / name)
            found[name] = {"begin_s": round(time.process_time() - started, 1)}
        numbers = {name: iter(range(settings.epochs)) for name in SYSTEMS}
        epoch_s = _medians_s(
            {
                name: lambda own=own, n=numbers[name]: own.epoch(next(n), validate=True)
                for name, own in trainings.items()
            },
            turns,
        )
        predict = {
            name: predictors()[name].load(own.arrays(), data.body)
            for name, own in trainings.items()
        }
    (clip, *_) = data.train
    theta, betas = clip.inputs[:, N_BETAS:], clip.betas
    motion_s = _medians_s(
        {name: lambda own=own: own(theta, betas) for name, own in predict.items()}, turns
    )
    for name in SYSTEMS:
        found[name]["epoch_s"] = round(epoch_s[name], 4)
        found[name]["frame_us"] = round(1e6 * motion_s[name] / len(theta), 2)
    return found


def _medians_s(functions: Mapping[str, Callable[[], object]], turns: int) -> dict[str, float]:
    """Of each, all in turn; the first turns are not counted."""
    taken = [
        {name: _seconds(function) for name, function in functions.items()}
        for _ in range(_WARM_UPS + turns)
    ]
    return {name: statistics.median(t[name] for t in taken[_WARM_UPS:]) for name in functions}


def _random_data(sequences: int) -> TrainingData:
    rng = np.random.default_rng(0)

    def clip() -> UnpaddedClip:
        inputs, latents = (
            0.3 * rng.standard_normal((FRAMES, size), dtype=np.float32)
            for size in (INPUT_SIZE, LATENT_SIZE)
        )
        inputs[:, :N_BETAS] = inputs[0, :N_BETAS]
        return UnpaddedClip(inputs, latents)

    body = load_body_model("embedded:female")
    return TrainingData([clip() for _ in range(sequences)], [clip()], lambda: body)


def _seconds(function: Callable[[], object]) -> float:
    started = time.process_time()
    function()
    return time.process_time() - started


if __name__ == "__main__":
    run_as_process(SecondsConfig, main)
