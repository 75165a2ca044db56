"""`python -m benchmarks.claims.batch_norm --out FILE`: does it keep values within [-1, 1]?

Of a run's two DSNets, on the training clips and on the held-out one: the share of values outside of
[-1, 1] behind the batch normalisation (Section 5), and behind the LSTM before it, whose own are
products of a sigmoid and a tanh.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.processes import run_as_process
from bridge.exchange.dsnet import DSNETS, TrainedDsnet, load_trained_dsnet, load_unpadded_clips
from bridge.paper import INPUT_SIZE
from bridge.runs import Artifact, Run
from bridge.runs.files import write_text_atomically
from tf_dsnet.framework import keras, tf
from tf_dsnet.model import BlockLSTM, assign_weights, build_dsnet

LAYERS = ("lstm", "batch_norm")


@dataclass(frozen=True)
class BatchNormConfig:
    """Measure a run that has trained its networks; takes seconds."""

    out: Path
    """JSON file to write."""
    run: str = "demo"
    """Name of the run."""


def main(config: BatchNormConfig) -> None:
    """Write the results."""
    stages = Run(config.run).artifacts("encode", "train")
    results = {
        "command": " ".join(["python", "-m", "benchmarks.claims.batch_norm", *sys.argv[1:]]),
        "run": config.run,
        "networks": {
            name: outside(load_trained_dsnet(stages["train"], name), stages["encode"])
            for name in DSNETS
        },
    }
    config.out.parent.mkdir(parents=True, exist_ok=True)
    write_text_atomically(config.out, json.dumps(results, indent=1, allow_nan=False) + "\n")


def outside(trained: TrainedDsnet, encode: Artifact) -> dict[str, dict[str, dict[str, float]]]:
    """By split and layer: the share of values outside [-1, 1], and the largest size of one."""
    model = build_dsnet(lstm_layer=BlockLSTM)
    assign_weights(model, trained.weights)
    inside = keras.Model(model.input, [model.get_layer(name).output for name in LAYERS])
    traced = tf.function(
        lambda motion: inside(motion, training=False),
        input_signature=[tf.TensorSpec((None, None, INPUT_SIZE), tf.float32)],
    )
    found: dict[str, dict[str, dict[str, float]]] = {}
    for split in ("train", "validation"):
        clips = load_unpadded_clips(encode, split)
        seen = [traced(trained.scaling.inputs(clip.inputs)[None]) for clip in clips]
        found[split] = {}
        for place, name in enumerate(LAYERS):
            sizes = np.abs(np.concatenate([np.ravel(layers[place]) for layers in seen]))
            found[split][name] = {
                "outside": round(float((sizes > 1).mean()), 4),
                "largest": round(float(sizes.max()), 3),
            }
    return found


if __name__ == "__main__":
    run_as_process(BatchNormConfig, main)
