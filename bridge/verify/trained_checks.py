"""The checks on a run's own weights and motions; a stage that is not there has none."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.exchange import load_weights
from bridge.exchange.dsnet import (
    TrainedDsnet,
    dsnets_of,
    load_trained_dsnet,
    load_unpadded_clips,
    make_clips,
)
from bridge.paper import N_VERTICES
from bridge.runs import Artifact, Run
from bridge.runs.run import body_model_path
from bridge.tissue.trained_plus import TrainedPlus
from bridge.verify.checks import (
    IN_FLOAT64,
    STREAM,
    WITH_ONNX,
    Check,
    Plan,
    autoencoder_checks,
    dsnet_graph_check,
    dsnet_training,
    plus_graph_check,
)

CLIPS, FRAMES, MESHES, GRAPH_FRAMES = 2, 120, 2, 8
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
    return plan + _graphs(run)


def _dsnet(trained: TrainedDsnet, encoded: Artifact) -> Plan:
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


def _graphs(run: Run) -> Plan:
    """The deployable graphs that the run has the parts of, on its own poses and persons."""
    plan = Plan([], {})
    if run.finished("train_plus"):
        weights = TrainedPlus.load(run.artifact("train_plus")).arrays()
        body = str(body_model_path(run))
        check = plus_graph_check("plus-graph-trained", "plus-trained", "stream-trained", body)
        plan = plan + Plan([check], {"plus-trained": weights})
    if run.finished("train") and run.finished("train-ae"):
        codec, train = run.artifact("train-ae"), run.artifact("train")
        of_the_body = codec.manifest["architecture"]["widths"][0] == N_VERTICES
        if of_the_body and (names := dsnets_of(train)):
            network = load_trained_dsnet(train, names[0])
            weights = {**network.arrays(), **_autoencoder_weights(codec)}
            check = dsnet_graph_check(
                "dsnet-graph-trained", "dsnet-graph-trained", "stream-trained",
                str(body_model_path(run)), **_architecture(codec),
            )  # fmt: skip
            plan = plan + Plan([check], {"dsnet-graph-trained": weights})
    if plan.checks:
        plan = plan + Plan([], {"stream-trained": _stream(run.artifact("align"))})
    return plan


def _stream(align: Artifact) -> dict[str, NDArray]:
    """Two characters, eight frames from two places of the corpus."""
    theta, betas = align.array("theta"), align.array("betas")
    starts = (len(theta) // 4, len(theta) // 2)
    clips = [np.asarray(theta[start : start + GRAPH_FRAMES], np.float32) for start in starts]
    persons = np.asarray(betas, np.float32)[[0, -1]]
    return {"theta": np.stack(clips, axis=1), "betas": persons}


def _autoencoder_weights(train_ae: Artifact) -> dict[str, NDArray]:
    stored = load_weights(train_ae.file("autoencoder.safetensors"))
    return {name.removeprefix("model."): array for name, array in stored.items()}


def _architecture(train_ae: Artifact) -> dict[str, Any]:
    architecture = dict(train_ae.manifest["architecture"])
    return {**architecture, "widths": tuple(architecture["widths"])}


def _autoencoder(train_ae: Artifact, align: Artifact) -> Plan:
    weights = _autoencoder_weights(train_ae)
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
    forward, gradients = autoencoder_checks(
        "ae-trained", "ae-trained", "values-trained", **_architecture(train_ae)
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
