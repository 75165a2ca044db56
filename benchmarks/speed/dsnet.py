"""Timings of DSNet at the paper's sizes: an epoch of training, a step of streaming."""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.processes import run_as_process
from benchmarks.speed.results import write_results
from bridge.exchange.dsnet import Clips, Scaling, TrainedDsnet
from bridge.paper import INPUT_SIZE, LATENT_SIZE, N_BETAS, THETA_SIZE
from dsnet.stream.streaming_predictor import StreamingPredictor
from tf_dsnet.framework import keras, tf
from tf_dsnet.model import BlockLSTM, build_dsnet, named_weights
from tf_dsnet.trainer import Trainer

SEQUENCES, FRAMES = 67, 300
"""Size of the paper's female training data (Table 1, Section 5)."""
_WARM_UPS = 2


@dataclass(frozen=True)
class KerasBenchConfig:
    """Time DSNet on random data; costs half a minute."""

    run: str = "demo"
    """Folder under runs/ that receives bench/tensorflow.json."""
    seed: int = 0
    """Seed of the random data and weights."""
    epochs: int = 10
    """Epochs to time, after two that are not."""
    steps: int = 2000
    """Streaming steps to time, after two that are not."""


def main(config: KerasBenchConfig) -> None:
    """Measure and write the results."""
    rng = np.random.default_rng(config.seed)
    epochs = time_epoch(rng, config.epochs)
    results = {
        "epoch_s": epochs["BlockLSTM"],
        "epoch_keras_lstm_s": epochs["LSTM"],
        "epoch_sequences": SEQUENCES,
        "epoch_frames": FRAMES,
        "step_us": {str(b): time_step(rng, b, config.steps) for b in (1, 16)},
        "cores": os.cpu_count(),
        "gpus": len(tf.config.list_physical_devices("GPU")),
        "versions": {"tensorflow": tf.__version__, "keras": keras.__version__},
    }
    write_results(config.run, "tensorflow", results)


def time_epoch(rng: np.random.Generator, epochs: int) -> dict[str, float]:
    """Median seconds of a training epoch on 67 x 300 random frames, batch 16.

    With the LSTM that training uses, and with Keras's own: turn by turn, so that other load
    hits both alike.
    """
    clips = Clips(
        _normal(rng, SEQUENCES, FRAMES, INPUT_SIZE),
        _normal(rng, SEQUENCES, FRAMES, LATENT_SIZE),
        np.ones((SEQUENCES, FRAMES), bool),
    )
    trainers = {
        layer.__name__: Trainer(clips, lr=1e-4, build=partial(build_dsnet, lstm_layer=layer))
        for layer in (BlockLSTM, keras.layers.LSTM)
    }
    turns = [
        {name: _seconds(lambda own=own: own.epoch(0)) for name, own in trainers.items()}
        for _ in range(_WARM_UPS + epochs)
    ]
    return {name: statistics.median(turn[name] for turn in turns[_WARM_UPS:]) for name in trainers}


def time_step(rng: np.random.Generator, characters: int, steps: int) -> float:
    """Median microseconds of one streaming step of several characters."""
    trained = TrainedDsnet("dsnet", named_weights(build_dsnet()), Scaling.identity())
    predictor = StreamingPredictor(trained)
    theta, betas = _normal(rng, characters, THETA_SIZE), _normal(rng, characters, N_BETAS)
    return 1e6 * _median_s(lambda: predictor.step(theta, betas), steps)


def _normal(rng: np.random.Generator, *shape: int) -> NDArray[np.float32]:
    return rng.standard_normal(shape, dtype=np.float32)


def _median_s(function: Callable[[], object], repeats: int) -> float:
    return statistics.median([_seconds(function) for _ in range(_WARM_UPS + repeats)][_WARM_UPS:])


def _seconds(function: Callable[[], object]) -> float:
    started = time.perf_counter()
    function()
    return time.perf_counter() - started


if __name__ == "__main__":
    run_as_process(KerasBenchConfig, main)
