"""The checks of `dsnet verify`: on random weights with extreme inputs, and on a run's weights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body import load_body_model
from bridge.exchange.dsnet import (
    TrainedDsnet,
    dsnets_of,
    load_trained_dsnet,
    load_unpadded_clips,
    make_clips,
)
from bridge.exchange.engine import NORMALISER, DTypeName, Tensors
from bridge.exchange.weights import load_autoencoder
from bridge.paper import INFERRED_WIDTHS, INPUT_SIZE, LATENT_SIZE, N_VERTICES
from bridge.runs import Artifact, Run
from bridge.runs.run import body_model_path
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.verify import draws
from dsnet.verify.draws import SMALL_WIDTHS
from dsnet.verify.engines import Check

BOTH: tuple[DTypeName, ...] = ("float64", "float32")
DOUBLE, SINGLE = BOTH[:1], BOTH[1:]
FRAMEWORKS = {"torch": BOTH, "keras": BOTH}
IN_FLOAT64 = {"torch": DOUBLE, "keras": DOUBLE}
ONNX, STREAM = {"onnx": SINGLE}, {"stream": SINGLE}

CLIPS, FRAMES, MESHES, GRAPH_FRAMES = 2, 120, 2, 8
Options = Mapping[str, Any]


def random_checks(seed: int, body: str) -> list[Check]:
    """Checks that need no run: small networks of random weights, usual and extreme inputs."""
    small = [*_dsnet(seed), *_autoencoder(seed), *_smpl(seed, body), *_oscillators(seed)]
    data = load_body_model(body)
    options = _architecture((data.vertex_count, *SMALL_WIDTHS[1:]))
    dsnet = {
        **draws.dsnet_weights(seed),
        **draws.autoencoder_weights(seed, options["architecture"]["widths"]),
        **_normaliser(data.vertex_count),
    }
    plus, stream = draws.tissue(seed, data), draws.stream(seed, 8, 2)
    stream["betas"][1] = plus["people_betas"][0]  # the second character is a training subject
    return [
        *small,
        Check("dsnet-graph", "dsnet_graph", ONNX, dsnet, stream, {"body": body, **options}),
        Check("plus-graph", "plus_graph", ONNX, plus, stream, {"body": body}),
    ]


def full_size_checks(seed: int) -> list[Check]:
    """Checks of the autoencoder at its 33,626,606 parameters, on two meshes."""
    weights = draws.autoencoder_weights(seed, INFERRED_WIDTHS)
    values = draws.values(seed, 2, INFERRED_WIDTHS[0])
    options = _architecture(INFERRED_WIDTHS)
    return [
        _ae_forward("ae-full", weights, values, options),
        _ae_train("ae-full-gradients", weights, values, options, ()),
        _ae_decode("ae-full-decoder", weights, options),
    ]


def _dsnet(seed: int) -> list[Check]:
    weights, clips = draws.dsnet_weights(seed), draws.clips(seed, 4, 30)
    motion = draws.motion(seed, 3, 40)

    def forward(name: str, inputs: Tensors, run: str = "whole") -> Check:
        return _dsnet_forward(f"dsnet-{name}", weights, inputs, run)

    extremes = {
        "T1": draws.motion(seed, 3, 1),
        "T1000": draws.motion(seed, 1, 1000),
        "zeros": {"motion": np.zeros((2, 20, INPUT_SIZE), np.float32)},
        "large": draws.motion(seed, 2, 20, size=5.0),
    }
    # Streams reject a joint rotated by more than two full turns.
    streamed = extremes | {"large": draws.motion(seed, 2, 20, size=2.5)}
    streams = {"stream": motion} | {f"stream-{name}": one for name, one in streamed.items()}
    return [
        forward("whole-clip", motion),
        forward("frame-by-frame", motion, "steps"),
        forward("singles", motion, "singles"),
        *(forward(name, inputs) for name, inputs in extremes.items()),
        # tanh of +-500. In float32 the argument itself is too inexact, before any engine's tanh.
        replace(forward("saturating", draws.motion(seed, 2, 20, size=50.0)), engines=IN_FLOAT64),
        *(Check(f"dsnet-{n}", "dsnet_stream", STREAM, weights, m) for n, m in streams.items()),
        _dsnet_train("dsnet-training", weights, clips, (1, 10)),
        _dsnet_train("dsnet-training-masked", weights, clips, (1, 10), masked=True),
        # Beyond ten steps rounding grows as the training goes: what float32 gives is its own.
        replace(_dsnet_train("dsnet-trajectory", weights, clips, (90,)), engines=IN_FLOAT64),
        Check("dsnet-fit", "dsnet_fit", {"keras": BOTH}, weights, clips, {"steps": (1, 10)}),
    ]


def _autoencoder(seed: int) -> list[Check]:
    weights, vertices = draws.autoencoder_weights(seed, SMALL_WIDTHS), SMALL_WIDTHS[0]
    values, options = draws.values(seed, 3, vertices), _architecture(SMALL_WIDTHS)

    def forward(name: str, inputs: Tensors = values, options: Options = options) -> Check:
        return _ae_forward(f"ae-{name}", weights, inputs, options)

    return [
        forward("batch"),
        forward("singles", options={**options, "run": "singles"}),
        forward("zeros", {"values": np.zeros((2, vertices, 3), np.float32)}),
        forward("large", draws.values(seed, 3, vertices, size=1e3)),
        _ae_train("ae-training", weights, values, options, (1, 10)),
        _ae_decode("ae-decoder", weights, options),
        *_other_widths("one-convolution", seed, SMALL_WIDTHS[:2]),
        *_other_widths("two-convolutions", seed, SMALL_WIDTHS[:3]),
        *_other_widths("widening", seed, SMALL_WIDTHS[::-1]),
    ]


def _other_widths(name: str, seed: int, widths: tuple[int, ...]) -> list[Check]:
    weights, options = draws.autoencoder_weights(seed, widths), _architecture(widths)
    values = draws.values(seed, 3, widths[0])
    return [
        _ae_forward(f"ae-{name}", weights, values, options),
        _ae_decode(f"ae-decoder-{name}", weights, options),
    ]


def _smpl(seed: int, body: str) -> list[Check]:
    data = load_body_model(body)
    poses = {
        "moderate": draws.poses(seed, 3, 24, 0.5),
        "rest": draws.poses(seed, 1, 24, 0.0),
        "half-turns": draws.poses(seed, 2, 24, np.pi),
        "large": draws.poses(seed, 2, 22, 11.0),
    }
    # Large rotations collapse skinned vertices between two bones, so skinning has no inverse there.
    collapsing = ("half-turns", "large")
    return [
        Check(
            f"smpl-{name}",
            "smpl",
            FRAMEWORKS,
            inputs=draws.bodies(seed, data, pose),
            options={"body": body},
            leave_out=("layer/unposed",) if name in collapsing else (),
        )
        for name, pose in poses.items()
    ]


def _oscillators(seed: int) -> list[Check]:
    """Checks of the training of `dsnet_plus`; steps of Adam only in float64."""
    first = Check(
        "oscillators",
        "oscillators_train",
        {"keras": BOTH},
        draws.oscillators(seed),
        draws.windows(seed),
        {"learning_rate": 0.06, "steps": ()},
    )
    options = {**first.options, "steps": (1, 3)}
    return [
        first,
        replace(first, name="oscillators-training", engines={"keras": DOUBLE}, options=options),
    ]


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
    checks = [check for d in dsnets for check in _trained_dsnet(d, run.artifact("encode"))]
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


def _trained_dsnet(trained: TrainedDsnet, encoded: Artifact) -> list[Check]:
    splits = ("validation", "train")
    recordings = [r for split in splits for r in load_unpadded_clips(encoded, split)][:CLIPS]
    padded = make_clips(recordings, trained.scaling, FRAMES)
    clips = {"motion": padded.inputs, "latents": padded.latents, "real": padded.real}
    motion = {"motion": recordings[0].inputs[None, :FRAMES].astype(np.float32)}
    key, weights, inputs = trained.name.replace("_", "-"), dict(trained.weights), clips["motion"]
    return [
        _dsnet_forward(key, weights, {"motion": inputs}),
        _dsnet_forward(f"{key}-frame-by-frame", weights, {"motion": inputs}, "steps"),
        Check(f"{key}-stream", "dsnet_stream", STREAM, trained.arrays(), motion),
        _dsnet_train(f"{key}-gradients", weights, clips, ()),
        # Adam's first step is little more than the sign of the gradient. Gradients of trained
        # weights are near zero, and float32 cannot determine their sign.
        replace(_dsnet_train(f"{key}-training", weights, clips, (1,)), engines=IN_FLOAT64),
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
    gradients = _ae_train("ae-trained-gradients", bare, inputs, options, ())
    return [
        _ae_forward("ae-trained", weights, {"values": offsets_m}, options),
        replace(gradients, engines=IN_FLOAT64),
    ]


def _stream(align: Artifact) -> Tensors:
    """Eight frames each of two characters, from two places in the corpus."""
    theta, betas = align.array("theta"), align.array("betas")
    starts = (len(theta) // 4, len(theta) // 2)
    poses = [np.asarray(theta[start : start + GRAPH_FRAMES], np.float32) for start in starts]
    return {"theta": np.stack(poses, axis=1), "betas": np.asarray(betas, np.float32)[[0, -1]]}


def _architecture(widths: tuple[int, ...]) -> dict[str, Any]:
    return {"architecture": {"widths": widths}}


def _dsnet_forward(name: str, weights: Tensors, inputs: Tensors, run: str = "whole") -> Check:
    return Check(name, "dsnet_forward", FRAMEWORKS, weights, inputs, {"run": run})


def _dsnet_train(
    name: str, weights: Tensors, clips: Tensors, steps: tuple[int, ...], *, masked: bool = False
) -> Check:
    options = {"masked": masked, "steps": steps}
    return Check(name, "dsnet_train", FRAMEWORKS, weights, clips, options)


def _ae_forward(name: str, weights: Tensors, values: Tensors, options: Options) -> Check:
    return Check(name, "ae_forward", FRAMEWORKS, weights, values, {"run": "whole", **options})


def _ae_decode(name: str, weights: Tensors, options: dict[str, Any]) -> Check:
    latents = np.random.default_rng(0).normal(size=(3, LATENT_SIZE)).astype(np.float32)
    metric = {**weights, **_normaliser(options["architecture"]["widths"][0])}
    return Check(name, "ae_decode", ONNX, metric, {"latents": latents}, options)


def _normaliser(vertices: int) -> Tensors:
    return {n: np.full((vertices, 3), k * 1e-3, np.float32) for k, n in enumerate(NORMALISER, 1)}


def _ae_train(
    name: str, weights: Tensors, values: Tensors, options: Options, steps: tuple[int, ...]
) -> Check:
    return Check(name, "ae_train", FRAMEWORKS, weights, values, {**options, "steps": steps})
