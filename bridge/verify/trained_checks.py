"""The checks on a run's own weights and motions; a stage that is not there has none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bridge.exchange import load_weights
from bridge.exchange.clips import load_unpadded_clips, make_clips
from bridge.exchange.input_kinds import POSES
from bridge.exchange.trained_dsnet import TrainedDsnet, dsnets_of, load_trained_dsnet
from bridge.runs import Artifact, Run
from bridge.runs.processes import notify
from bridge.verify.checks import (
    IN_FLOAT64,
    STREAM,
    WITH_ONNX,
    Check,
    Plan,
    autoencoder_checks,
    dsnet_training,
)

CLIPS, FRAMES, MESHES = 2, 120, 2
_NORMALISER = ("normaliser.mean_m", "normaliser.scale_m")


def trained_plan(run: Run) -> Plan:
    """Checks of every predictor and of the autoencoder that the run has trained."""
    plan = Plan([], {})
    if run.finished("train"):
        train, encoded = run.artifact("train"), run.artifact("encode")
        for name in dsnets_of(train):
            plan = plan + _dsnet(load_trained_dsnet(train, name), encoded)
    if run.finished("train-ae"):
        plan = plan + _autoencoder(run.artifact("train-ae"), run.artifact("align"))
    return plan


def _dsnet(trained: TrainedDsnet, encoded: Artifact) -> Plan:
    if trained.input_kind != POSES:
        notify(f"{trained.name} is not compared: it is told of {trained.input_kind.name}")
        return Plan([], {})
    recordings = [
        *load_unpadded_clips(encoded, "validation"),
        *load_unpadded_clips(encoded, "train"),
    ]
    recordings = recordings[:CLIPS]
    clips = make_clips(recordings, trained.scaling, FRAMES)
    raw = [recording.inputs[: min(FRAMES, len(recordings[0].inputs))] for recording in recordings]
    key = trained.name.replace("_", "-")
    arrays = {
        key: dict(trained.weights),
        f"{key}-scaled": trained.arrays(),
        f"{key}-clips": {"motion": clips.inputs, "latents": clips.latents, "real": clips.real},
        f"{key}-motion": {"motion": raw[0][None].astype(np.float32)},
    }
    whole = Check(key, "dsnet_forward", WITH_ONNX, key, f"{key}-clips", {"run": "whole"})
    checks = [
        whole,
        replace(whole, name=f"{key}-frame-by-frame", options={"run": "steps"}),
        Check(f"{key}-stream", "dsnet_stream", STREAM, f"{key}-scaled", f"{key}-motion"),
        dsnet_training(f"{key}-gradients", key, f"{key}-clips", masked=False, steps=()),
        # Adam's first step is hardly more than a gradient's sign, which float32 does not know of
        # the gradients near zero that trained weights have.
        replace(
            dsnet_training(f"{key}-training", key, f"{key}-clips", masked=False, steps=(1,)),
            engines=IN_FLOAT64,
        ),
    ]
    return Plan(checks, arrays)


def _autoencoder(train_ae: Artifact, align: Artifact) -> Plan:
    stored = load_weights(train_ae.file("autoencoder.safetensors"))
    weights = {name.removeprefix("model."): array for name, array in stored.items()}
    mean_m, scale_m = (weights[name] for name in _NORMALISER)
    offsets_m = _spread_frames(align.array("offsets"), MESHES)
    rng = np.random.default_rng(0)
    arrays = {
        "ae-metres": weights,
        "ae-trained": {n: array for n, array in weights.items() if n not in _NORMALISER},
        "offsets": {"offsets_m": offsets_m},
        "values-trained": {
            "values": ((offsets_m - mean_m) / scale_m).astype(np.float32),
            # Training begins with the least-squares solution and ends near another: there each
            # gradient is the difference of equal sums, of which any engine keeps the rounding.
            "target": rng.normal(size=offsets_m.shape).astype(np.float32),
        },
    }
    architecture = dict(train_ae.manifest["architecture"])
    architecture["widths"] = tuple(architecture["widths"])
    forward, gradients = autoencoder_checks(
        "ae-trained", "ae-trained", "values-trained", **architecture
    )
    in_metres = replace(
        forward,
        weights="ae-metres",
        inputs="offsets",
        options={**forward.options, "metres": True},
    )
    # A gradient jumps at the kinks of LeakyReLU, and of the trained network's hundred thousands of
    # units some stand nearer to one than float32 can tell.
    return Plan([in_metres, replace(gradients, engines=IN_FLOAT64)], arrays)


def _spread_frames(frames: NDArray, count: int) -> NDArray[np.float32]:
    rows = np.linspace(0, len(frames) - 1, count + 2).astype(int)[1:-1]
    return np.asarray(frames[rows], dtype=np.float32)
