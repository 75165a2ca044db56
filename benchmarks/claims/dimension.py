"""`python -m benchmarks.claims.dimension --out FILE`: DSNet that gives offsets in place of codes.

The same network on what the paper's aligner gives: with its 100 latents, with 100 principal
components, and with a last layer as wide as the 20,670 numbers of a mesh, for as many epochs. Each
as the paper has it, nothing scaled at Adam's rate 0.0001, and standardised at 0.001.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from benchmarks.claims.by_the_paper import keras_decoder, unscaled
from benchmarks.claims.data import PapersData
from benchmarks.claims.looked_into import by_cell
from benchmarks.claims.references import Decode, InOffsets, ScoredMotion
from benchmarks.processes import run_as_process
from bridge.exchange import load_weights
from bridge.exchange.dsnet import (
    AUTOENCODER,
    LINEAR_FILES,
    PCA,
    TrainedDsnet,
    UnpaddedClip,
    fit_scaling,
    join_inputs,
    load_unpadded_clips,
    make_clips,
)
from bridge.exchange.train_options import PredictorSettings
from bridge.runs import Artifact, Run
from bridge.runs.files import write_text_atomically
from dsnet.evaluation.pipelines import MotionArrays
from tf_dsnet.model import BlockLSTM, build_dsnet, named_weights, parameter_counts
from tf_dsnet.predictors import applied_dsnet
from tf_dsnet.trainer import Trainer

RAW = "offsets"
CODES = (AUTOENCODER, PCA, RAW)
READINGS = ("paper", "standardised")


@dataclass(frozen=True)
class DimensionConfig:
    """Train and score; what a file has of the same data is kept, so that a killed study goes on."""

    out: Path
    """JSON file to write."""
    run: str = "demo"
    """Run of the paper's pipeline, evaluated."""
    epochs: int = 100
    """Of each network; one that gives offsets takes seconds for each."""
    seed: int = 0
    """Training seed."""


def main(config: DimensionConfig) -> None:
    """Write what is missing."""
    run = Run(config.run)
    data = PapersData(run, keras_decoder)
    stages = run.artifacts("align", "encode", "train-ae")
    same = {"epochs": config.epochs, "seed": config.seed, **data.identity()}
    found = json.loads(config.out.read_text(encoding="utf-8")) if config.out.exists() else {}
    if any(found.get(name) != value for name, value in same.items()):
        found = {**same, "systems": {}}
    found["command"] = " ".join(["python", "-m", "benchmarks.claims.dimension", *sys.argv[1:]])
    found["run"] = config.run
    settings = PredictorSettings(epochs=config.epochs, seed=config.seed)
    config.out.parent.mkdir(parents=True, exist_ok=True)
    for code in CODES:
        decode = _decoder(stages["train-ae"], code)
        tested = [
            replace(one, reference=InOffsets(one.reference.arrays, one.name, decode))
            for one in data.tested
            if isinstance(one.reference, InOffsets)
        ]
        for reading in READINGS:
            name = f"{code} {reading}"
            if name not in found["systems"]:
                print(name, flush=True)
                clips = _clips(stages["align"], stages["encode"], code)
                found["systems"][name] = scored(
                    clips, tested, settings, standardised=reading == "standardised"
                )
                text = json.dumps(found, indent=1, allow_nan=False)
                write_text_atomically(config.out, text + "\n")


def scored(
    clips: list[UnpaddedClip],
    tested: Sequence[ScoredMotion],
    settings: PredictorSettings,
    *,
    standardised: bool,
) -> dict[str, Any]:
    """Train DSNet with a last layer as wide as the clips' codes, and hold it against the tests."""
    build = partial(build_dsnet, widths={"fc_enc_3": clips[0].latents.shape[1]})
    scaling = fit_scaling(clips, settings.min_input_std) if standardised else unscaled(clips[0])
    trainer = Trainer(
        make_clips(clips, scaling, settings.frames),
        lr=settings.lr_standardised if standardised else settings.lr_faithful,
        batch_size=settings.batch_size,
        seed=settings.seed,
        build=partial(build, lstm_layer=BlockLSTM),
    )
    trainer.trace()
    started = time.perf_counter()
    losses = [trainer.epoch(number) for number in range(settings.epochs)]
    train_s = time.perf_counter() - started
    trained = TrainedDsnet("dsnet", named_weights(trainer.model), scaling)
    codes_of = applied_dsnet(trained, build)
    return {
        "parameters": next(iter(parameter_counts(trainer.model).values())),
        "epoch_s": round(train_s / settings.epochs, 3),
        "loss": [float(f"{loss:.5g}") for loss in losses],
        "r2": by_cell(lambda theta, betas: codes_of(join_inputs(theta, betas)), tested),
    }


def _clips(align: Artifact, encode: Artifact, code: str) -> list[UnpaddedClip]:
    """The training sequences with a code, or with their offsets (T, V * 3) in metres."""
    if code in (AUTOENCODER, PCA):
        return load_unpadded_clips(encode, "train", AUTOENCODER if code == AUTOENCODER else PCA)
    arrays = MotionArrays.of(align)

    def clip(name: str) -> UnpaddedClip:
        theta, offsets_m = (arrays.frames(n, name, slice(None)) for n in ("theta", "offsets"))
        inputs = join_inputs(theta, arrays.betas(name))
        return UnpaddedClip(inputs, offsets_m.reshape(len(offsets_m), -1))

    return [clip(one.name) for one in arrays.sequences.values() if one.split == "train"]


def _decoder(trained: Artifact, code: str) -> Decode:
    """From a code to offsets (B, V, 3), metres."""
    if code == AUTOENCODER:
        return keras_decoder(trained)
    if code == RAW:
        return lambda codes: codes.reshape(len(codes), -1, 3)
    linear = load_weights(trained.file(LINEAR_FILES[PCA]))
    directions, mean_m = linear["components"], linear["mean_m"]

    def decode(codes: NDArray) -> NDArray:
        return (codes @ directions).reshape(len(codes), -1, 3) + mean_m

    return decode


if __name__ == "__main__":
    run_as_process(DimensionConfig, main)
