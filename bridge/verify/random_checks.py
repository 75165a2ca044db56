"""The checks that need no run: random weights, and inputs at the edge of what may come."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np

from bridge.body import load_body_model
from bridge.exchange.weights import KERAS_ADAM, TORCH_ADAM
from bridge.paper import INFERRED_WIDTHS, INPUT_SIZE
from bridge.verify import draws
from bridge.verify.checks import (
    FILES,
    FRAMEWORKS,
    IN_FLOAT64,
    KERAS,
    STREAM,
    WITH_ONNX,
    Check,
    Plan,
    autoencoder_checks,
    autoencoder_options,
    dsnet_graph_check,
    dsnet_training,
    plus_graph_check,
)
from bridge.verify.draws import SMALL_WIDTHS


def random_plan(seed: int, body: str) -> Plan:
    """Everything that needs no run: random weights in small, and the extremes."""
    small = _dsnet(seed) + _autoencoder(seed) + _smpl(seed, body) + _oscillators(seed)
    return small + _graphs(seed, body) + _files()


def full_size_plan(seed: int) -> Plan:
    """The autoencoder's 33,626,606 parameters: every layer and every gradient, two meshes."""
    arrays = {
        "ae-full": draws.autoencoder_weights(seed, INFERRED_WIDTHS),
        "values-full": draws.values(seed, 2, INFERRED_WIDTHS[0]),
    }
    return Plan(autoencoder_checks("ae-full", "ae-full", "values-full", INFERRED_WIDTHS), arrays)


def _dsnet(seed: int) -> Plan:
    arrays = {
        "dsnet": draws.dsnet_weights(seed),
        "motion": draws.motion(seed, 3, 40),
        "motion-T1": draws.motion(seed, 3, 1),
        "motion-T1000": draws.motion(seed, 1, 1000),
        "motion-large": draws.motion(seed, 2, 20, size=5.0),
        "motion-saturating": draws.motion(seed, 2, 20, size=50.0),
        "motion-zeros": {"motion": np.zeros((2, 20, INPUT_SIZE), np.float32)},
        "clips": draws.clips(seed, 4, 30),
    }

    def forward(name: str, inputs: str, run: str = "whole") -> Check:
        return Check(f"dsnet-{name}", "dsnet_forward", WITH_ONNX, "dsnet", inputs, {"run": run})

    whole = forward("whole-clip", "motion")
    checks = [
        whole,
        forward("frame-by-frame", "motion", "steps"),
        forward("singles", "motion", "singles"),
        forward("T1", "motion-T1"),
        forward("T1000", "motion-T1000"),
        forward("zeros", "motion-zeros"),
        forward("large", "motion-large"),
        # tanh of +-500: what float32 loses there is in the argument, before any engine's tanh.
        replace(forward("saturating", "motion-saturating"), engines=IN_FLOAT64),
        replace(whole, name="dsnet-stream", op="dsnet_stream", engines=STREAM),
        *(dsnet_training(f"dsnet-training{m}", "dsnet", "clips", bool(m)) for m in ("", "-masked")),
    ]
    return Plan(checks, arrays)


def _autoencoder(seed: int) -> Plan:
    vertices = SMALL_WIDTHS[0]
    arrays = {
        "ae": draws.autoencoder_weights(seed, SMALL_WIDTHS),
        "values": draws.values(seed, 3, vertices),
        "values-large": draws.values(seed, 3, vertices, size=1e3),
        "values-zeros": {"values": np.zeros((2, vertices, 3), np.float32)},
    }

    def forward(
        name: str, inputs: str, run: str = "whole", activation: str = "leaky_relu"
    ) -> Check:
        options = {**autoencoder_options(SMALL_WIDTHS, activation), "run": run}
        return Check(f"ae-{name}", "ae_forward", WITH_ONNX, "ae", inputs, options)

    options = {**autoencoder_options(SMALL_WIDTHS), "adam": asdict(TORCH_ADAM), "steps": (1, 10)}
    checks = [
        forward("batch", "values"),
        forward("singles", "values", "singles"),
        forward("zeros", "values-zeros"),
        forward("large", "values-large"),
        *(forward(name, "values", activation=name) for name in ("elu", "tanh", "relu")),
        Check("ae-training", "ae_train", FRAMEWORKS, "ae", "values", options),
    ]
    return Plan(checks, arrays)


def _smpl(seed: int, body: str) -> Plan:
    data = load_body_model(body)
    poses = {
        "moderate": draws.poses(seed, 3, 24, 0.5),
        "rest": draws.poses(seed, 1, 24, 0.0),
        "half-turns": draws.poses(seed, 2, 24, np.pi),
        "large": draws.poses(seed, 2, 22, 11.0),
    }
    arrays = {f"bodies-{name}": draws.bodies(seed, data, pose) for name, pose in poses.items()}
    # Bones turned far against each other collapse vertices between them: no inverse is defined.
    collapsing = ("half-turns", "large")
    checks = [
        Check(
            f"smpl-{name}",
            "smpl",
            FRAMEWORKS,
            inputs=f"bodies-{name}",
            options={"body": body},
            leave_out=("layer/unposed",) if name in collapsing else (),
        )
        for name in poses
    ]
    return Plan(checks, arrays)


def _oscillators(seed: int) -> Plan:
    """How `dsnet_plus` is trained; steps of Adam in float64 alone, as `trained_checks` says why."""
    arrays = {"oscillators": draws.oscillators(seed), "windows": draws.windows(seed)}
    adam = asdict(replace(KERAS_ADAM, learning_rate=0.06, beta_2=0.95))
    first = Check("oscillators", "oscillators_train", KERAS, "oscillators", "windows",
                  {"adam": adam, "steps": ()})  # fmt: skip
    steps = {"adam": adam, "steps": (1, 3)}
    training = replace(
        first, name="oscillators-training", engines={"keras": ("float64",)}, options=steps
    )
    return Plan([first, training], arrays)


def _graphs(seed: int, body: str) -> Plan:
    """Whole deployable graphs: two characters for eight frames, the second of them a known one."""
    data = load_body_model(body)
    widths = (data.vertex_count, *SMALL_WIDTHS[1:])
    normaliser = {
        "normaliser.mean_m": np.full((data.vertex_count, 3), 1e-3, np.float32),
        "normaliser.scale_m": np.full((data.vertex_count, 3), 2e-3, np.float32),
    }
    decoder = {**draws.autoencoder_weights(seed, widths), **normaliser}
    tissue, poses = draws.tissue(seed, data), draws.stream(seed, 8, 2)
    poses["betas"][1] = tissue["people_betas"][0]
    arrays = {
        "dsnet-graph": {**draws.dsnet_weights(seed), **decoder},
        "plus-graph": tissue,
        "stream": poses,
    }
    checks = [
        dsnet_graph_check("dsnet-graph", "dsnet-graph", "stream", body, widths=widths),
        plus_graph_check("plus-graph", "plus-graph", "stream", body),
    ]
    return Plan(checks, arrays)


def _files() -> Plan:
    small = {"network": "mesh_autoencoder", **autoencoder_options(SMALL_WIDTHS)}
    checks = [
        Check("dsnet-files", "formats", FILES, "dsnet", options={"network": "dsnet"}),
        Check("ae-files", "formats", FILES, "ae", options=small),
    ]
    return Plan(checks, {})
