"""The checks of `dsnet verify` that need no run: random weights, usual and extreme inputs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bridge.body import load_body_model
from bridge.exchange.engine import Tensors
from bridge.paper import INFERRED_WIDTHS, INPUT_SIZE
from dsnet.verify import draws
from dsnet.verify.draws import SMALL_WIDTHS
from dsnet.verify.engines import GPUS, Check
from dsnet.verify.single_checks import (
    BOTH,
    DOUBLE,
    FRAMEWORKS,
    IN_BFLOAT16,
    IN_FLOAT64,
    ONNX,
    SINGLE,
    STREAM,
    Options,
    ae_decode,
    ae_forward,
    ae_train,
    architecture,
    dsnet_files,
    dsnet_forward,
    dsnet_train,
    normaliser,
)

_ON_GPUS_TOO = (
    "dsnet-whole-clip", "dsnet-training", "ae-batch", "ae-training", "smpl-moderate"
)  # fmt: skip
BODIES, DESCENT_STEPS = 3, 50


def random_checks(seed: int, body: str) -> list[Check]:
    """Checks that need no run: small networks of random weights, usual and extreme inputs."""
    small = [
        *_dsnet(seed),
        *_autoencoder(seed),
        *_smpl(seed, body),
        *_descents(seed, body),
        *_oscillators(seed),
    ]
    data = load_body_model(body)
    options = architecture((data.vertex_count, *SMALL_WIDTHS[1:]))
    dsnet = {
        **draws.dsnet_weights(seed),
        **draws.autoencoder_weights(seed, options["architecture"]["widths"]),
        **normaliser(data.vertex_count),
    }
    plus, stream = draws.tissue(seed, data), draws.stream(seed, 8, 2)
    stream["betas"][1] = plus["people_betas"][0]  # the second character is a training subject
    return [
        *map(_on_gpus_too, small),
        Check("dsnet-graph", "dsnet_graph", ONNX, dsnet, stream, {"body": body, **options}),
        Check("plus-graph", "plus_graph", ONNX, plus, stream, {"body": body}),
        *_soft_tissue(seed, body, plus),
    ]


def _soft_tissue(seed: int, body: str, plus: Tensors) -> list[Check]:
    """The layer of PyTorch over whole motions, and its gradients along random directions."""
    given, options = draws.stream(seed, 8, 2), {"body": body}
    slopes = given | draws.directions(seed, plus, given)
    return [
        Check("soft-tissue", "soft_tissue", {"torch": BOTH}, plus, given, options),
        Check("soft-tissue-slopes", "soft_tissue_slopes", {"torch": SINGLE}, plus, slopes, options),
    ]


def _on_gpus_too(check: Check) -> Check:
    on_gpus = dict.fromkeys(GPUS, BOTH) if check.name in _ON_GPUS_TOO else {}
    return replace(check, engines={**check.engines, **on_gpus})


def full_size_checks(seed: int) -> list[Check]:
    """Checks of the autoencoder at its 33,626,606 parameters, on two meshes."""
    weights = draws.autoencoder_weights(seed, INFERRED_WIDTHS)
    values = draws.values(seed, 2, INFERRED_WIDTHS[0])
    options = architecture(INFERRED_WIDTHS)
    gradients = ae_train("ae-full-gradients", weights, values, options, ())
    # Among so many gradients some are zero but for float32's rounding, which Adam makes whole
    # steps of. What a step leaves is a gigabyte, and Keras takes half a minute for it.
    training = ae_train("ae-full-training", weights, values, options, (2,))
    return [
        ae_forward("ae-full", weights, values, options),
        replace(gradients, engines={"torch": SINGLE, "keras": BOTH}),
        replace(training, engines={"torch": DOUBLE}),
        ae_decode("ae-full-decoder", weights, options),
    ]


def _dsnet(seed: int) -> list[Check]:
    weights, clips = draws.dsnet_weights(seed), draws.clips(seed, 4, 30)
    motion = draws.motion(seed, 3, 40)

    def forward(name: str, inputs: Tensors, run: str = "whole") -> Check:
        return dsnet_forward(f"dsnet-{name}", weights, inputs, run)

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
        dsnet_train("dsnet-training", weights, clips, (1, 10)),
        dsnet_train("dsnet-training-masked", weights, clips, (1, 10), masked=True),
        # Beyond ten steps rounding grows as the training goes: what float32 gives is its own.
        replace(dsnet_train("dsnet-trajectory", weights, clips, (90,)), engines=IN_FLOAT64),
        Check("dsnet-fit", "dsnet_fit", {"keras": BOTH}, weights, clips, {"steps": (1, 10)}),
        *dsnet_files("dsnet", {**weights, **draws.scaling(seed)}, motion),
    ]


def _autoencoder(seed: int) -> list[Check]:
    weights, vertices = draws.autoencoder_weights(seed, SMALL_WIDTHS), SMALL_WIDTHS[0]
    values, many = (draws.values(seed, count, vertices) for count in (3, 256))
    options = architecture(SMALL_WIDTHS)

    def forward(name: str, inputs: Tensors = values, options: Options = options) -> Check:
        return ae_forward(f"ae-{name}", weights, inputs, options)

    return [
        forward("batch"),
        forward("singles", options={**options, "run": "singles"}),
        forward("zeros", {"values": np.zeros((2, vertices, 3), np.float32)}),
        forward("large", draws.values(seed, 3, vertices, size=1e3)),
        ae_train("ae-training", weights, values, options, (1, 10)),
        replace(forward("bfloat16"), engines=IN_BFLOAT16),
        # Of many meshes, as in training: a few units on the other side of LeakyReLU's kink, where
        # bfloat16 puts them, make much of the gradient of three.
        replace(
            ae_train("ae-bfloat16-training", weights, many, options, (1,)),
            engines=IN_BFLOAT16,
            leave_out=[f"step_1/weight/{name}" for name in weights],
        ),
        ae_decode("ae-decoder", weights, options),
        *_other_widths("one-convolution", seed, SMALL_WIDTHS[:2]),
        *_other_widths("two-convolutions", seed, SMALL_WIDTHS[:3]),
        *_other_widths("widening", seed, SMALL_WIDTHS[::-1]),
    ]


def _other_widths(name: str, seed: int, widths: tuple[int, ...]) -> list[Check]:
    weights, options = draws.autoencoder_weights(seed, widths), architecture(widths)
    values = draws.values(seed, 3, widths[0])
    return [
        ae_forward(f"ae-{name}", weights, values, options),
        ae_decode(f"ae-decoder-{name}", weights, options),
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


def _descents(seed: int, body: str) -> list[Check]:
    """The paper's alignment: poses alone from near them, and with shapes from the rest pose."""
    frames = draws.frames(seed, load_body_model(body), BODIES)
    inputs = {"align-pose": frames, "align-shape": {"mesh": frames["mesh"]}}
    options = {"body": body, "steps": DESCENT_STEPS}
    return [Check(n, "descent", {"torch": BOTH}, {}, given, options) for n, given in inputs.items()]


def _oscillators(seed: int) -> list[Check]:
    """Checks of the training of `dsnet_plus`; steps of Adam only in float64."""
    first = Check(
        "oscillators",
        "oscillators_train",
        FRAMEWORKS,
        draws.oscillators(seed),
        draws.windows(seed),
        {"learning_rate": 0.06, "steps": ()},
    )
    options = {**first.options, "steps": (1, 3)}
    return [
        first,
        replace(first, name="oscillators-training", engines=IN_FLOAT64, options=options),
    ]
