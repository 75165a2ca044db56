"""The checks of a run's own networks, on its own motions and meshes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bridge.exchange.dsnet import (
    TrainedDsnet,
    dsnets_of,
    load_trained_dsnet,
    load_unpadded_clips,
    make_clips,
)
from bridge.exchange.engine import NORMALISER, Tensors
from bridge.exchange.weights import load_autoencoder
from bridge.paper import N_VERTICES
from bridge.runs import Artifact, Run
from bridge.runs.run import body_model_path
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.verify.engines import Check
from dsnet.verify.single_checks import (
    IN_FLOAT64,
    ONNX,
    STREAM,
    Options,
    ae_forward,
    ae_train,
    dsnet_files,
    dsnet_forward,
    dsnet_train,
)

CLIPS, FRAMES, MESHES, GRAPH_FRAMES = 2, 120, 2, 8


def trained_checks(run: Run) -> list[Check]:
    """Checks of the run's trained networks that the reference implements, and of their graphs.

    Stages that the run has not finished have no checks.
    """
    train, train_ae, train_plus = (
        run.artifact(stage) if run.finished(stage) else None
        for stage in ("train", "train-ae", "train_plus")
    )
    loaded = [load_trained_dsnet(train, name) for name in dsnets_of(train)] if train else []
    dsnets = [network for network in loaded if network.is_papers]
    checks = [c for d in dsnets if train for c in _trained_dsnet(d, train, run.artifact("encode"))]
    graphs: list[tuple[str, str, Tensors, Options]] = []
    if train_plus:
        weights = TrainedPlus.load(train_plus).arrays()
        graphs.append(("plus-graph-trained", "plus_graph", weights, {}))
    if train_ae:
        weights, architecture = load_autoencoder(train_ae)
        options = {"architecture": dict(architecture)}
        checks += _trained_autoencoder(weights, options, run.artifact("align").array("offsets"))
        if dsnets and options["architecture"]["widths"][0] == N_VERTICES:
            both = {**dsnets[0].arrays(), **weights}
            graphs.append(("dsnet-graph-trained", "dsnet_graph", both, options))
    if graphs:
        stream, body = _stream(run.artifact("align")), {"body": str(body_model_path(run))}
        checks += [Check(n, op, ONNX, w, stream, {**body, **more}) for n, op, w, more in graphs]
    return checks


def _trained_dsnet(trained: TrainedDsnet, train: Artifact, encoded: Artifact) -> list[Check]:
    splits = ("validation", "train")
    recordings = [r for split in splits for r in load_unpadded_clips(encoded, split)][:CLIPS]
    padded = make_clips(recordings, trained.scaling, FRAMES)
    clips = {"motion": padded.inputs, "latents": padded.latents, "real": padded.real}
    motion = {"motion": recordings[0].inputs[None, :FRAMES].astype(np.float32)}
    key, weights, inputs = trained.name.replace("_", "-"), dict(trained.weights), clips["motion"]
    arrays, file = trained.arrays(), f"{trained.name}.keras"
    saved = str(train.file(file)) if file in train.manifest["files"] else ""
    return [
        dsnet_forward(key, weights, {"motion": inputs}),
        dsnet_forward(f"{key}-frame-by-frame", weights, {"motion": inputs}, "steps"),
        Check(f"{key}-stream", "dsnet_stream", STREAM, arrays, motion),
        *(dsnet_files(key, arrays, motion, saved) if saved else ()),
        dsnet_train(f"{key}-gradients", weights, clips, ()),
        # Adam's first step is little more than the sign of the gradient. Gradients of trained
        # weights are near zero, and float32 cannot determine their sign.
        replace(dsnet_train(f"{key}-training", weights, clips, (1,)), engines=IN_FLOAT64),
    ]


def _trained_autoencoder(weights: Tensors, options: Options, frames: NDArray) -> list[Check]:
    rows = np.linspace(0, len(frames) - 1, MESHES + 2).astype(int)[1:-1]
    offsets_m = np.asarray(frames[rows], dtype=np.float32)
    mean_m, scale_m = (weights[name] for name in NORMALISER)
    bare = {name: array for name, array in weights.items() if name not in NORMALISER}
    inputs = {
        "values": ((offsets_m - mean_m) / scale_m).astype(np.float32),
        # Random targets: near the minimum of the true loss, gradients are differences of nearly
        # equal sums, so that only rounding errors would be compared.
        "target": np.random.default_rng(0).normal(size=offsets_m.shape).astype(np.float32),
    }
    # Gradients only in float64: they jump at the kink of LeakyReLU, and among the hundreds of
    # thousands of units some are closer to it than float32 can resolve.
    gradients = ae_train("ae-trained-gradients", bare, inputs, options, ())
    return [
        ae_forward("ae-trained", weights, {"values": offsets_m}, options),
        replace(gradients, engines=IN_FLOAT64),
    ]


def _stream(align: Artifact) -> Tensors:
    """Eight frames each of two characters, from two places in the corpus."""
    theta, betas = align.array("theta"), align.array("betas")
    starts = (len(theta) // 4, len(theta) // 2)
    poses = [np.asarray(theta[start : start + GRAPH_FRAMES], np.float32) for start in starts]
    return {"theta": np.stack(poses, axis=1), "betas": np.asarray(betas, np.float32)[[0, -1]]}
