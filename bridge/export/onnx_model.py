"""A predictor with its body as one `.onnx` file that ONNX Runtime alone can run.

The file says of itself, in its metadata, all that a user must know to feed it; what its inputs,
outputs and state are stands in `plus_graph` and `dsnet_body_graph` of `bridge.runtime`.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.errors import DsnetError
from bridge.exchange import load_weights
from bridge.exchange.dsnet import TrainedDsnet, load_trained_dsnet
from bridge.export.output import new_path, refuse_taken
from bridge.paper import N_JOINTS, THETA_SIZE
from bridge.runs import Artifact
from bridge.runs.artifact import DataOrigin
from bridge.runtime.network_graphs import dsnet_body_graph
from bridge.runtime.onnx_graph import PRECISIONS, GraphSession, Precision
from bridge.runtime.plus_graph import plus_graph
from bridge.tissue.oscillators import FPS
from bridge.tissue.trained_plus import NAME, TrainedPlus

_BEND_RAD, _HOP_M = 0.6, 0.25


@dataclass(frozen=True, eq=False)
class DecodedDsnet:
    """A trained DSNet and the decoder of its latents."""

    network: TrainedDsnet
    decoder: Mapping[str, NDArray]
    """Named as by PyTorch, the normaliser's included."""
    architecture: Mapping[str, Any]
    """As in the manifest of `train-ae`."""


Exportable = TrainedPlus | DecodedDsnet


def load_exportable(artifacts: Mapping[str, Artifact], predictor: str) -> Exportable:
    """A predictor from the artifacts, by stage, of the pipeline that it is of."""
    if len(artifacts) == 1:
        return TrainedPlus.load(*artifacts.values())
    codec = artifacts["train-ae"]
    stored = load_weights(codec.file("autoencoder.safetensors"))
    decoder = {name.removeprefix("model."): array for name, array in stored.items()}
    network = load_trained_dsnet(artifacts["train"], predictor)
    return DecodedDsnet(network, decoder, codec.manifest["architecture"])


def export_onnx(
    model: Exportable,
    body: BodyModelData,
    path: Path,
    *,
    origin: DataOrigin,
    run: str = "",
    precision: Precision = "float32",
) -> Path:
    """Write one predictor with the body that it moves, whole or not at all.

    Costs a second, or with fewer bits some ten.

    Parameters
    ----------
    origin : of what it was trained on; a synthetic body makes it synthetic too.
    run : name of the run that it is from.
    precision : of the large kernels (`bridge.runtime.onnx_graph`). What fewer bits cost is
        measured and written into the file: `error_mm`, see `precision_error_mm`.

    Raises
    ------
    DsnetError
        If there is no such precision, the file exists or cannot be written, or predictor and body
        do not fit.
    """
    if precision not in PRECISIONS:
        known = ", ".join(PRECISIONS)
        raise DsnetError(f"precision {precision!r}", f"one of {known}", "Name one of these.")
    refuse_taken(path)
    about = _about(model, body, origin, run, precision)
    made = _graph(model, body, about, precision)
    if precision != "float32":
        error_mm = precision_error_mm(_graph(model, body, {}, "float32"), made)
        said = json.dumps({name: round(mm, 4) for name, mm in error_mm.items()})
        made.metadata_props.add(key="error_mm", value=said)
    with new_path(path) as partial:
        onnx.save_model(made, partial)
    return path


def precision_error_mm(exact: onnx.ModelProto, reduced: onnx.ModelProto) -> dict[str, float]:
    """What fewer bits cost: distances of the vertices of one motion by two graphs of a predictor.

    Three different bodies hop and swing all of their joints for a second.
    """
    session = GraphSession(exact)
    count = session.input_shapes["betas"][1]
    betas = np.repeat([[-1.0], [0.0], [1.0]], count, axis=1)
    times_s = np.arange(FPS)[:, None, None] / FPS
    joint = np.arange(THETA_SIZE)
    phase = 2.4 * np.arange(len(betas))[:, None] + 1.7 * joint
    theta = _BEND_RAD * np.sin(7 * times_s + phase) * np.cos(joint)  # (T, B, 69)
    theta[..., -3:] = 0
    theta[..., -2] = _HOP_M * np.abs(np.sin(8 * times_s[..., 0]))
    theta, betas = theta.astype(np.float32), betas.astype(np.float32)
    apart_m = GraphSession(reduced).rolled(theta, betas) - session.rolled(theta, betas)
    error_mm = 1e3 * np.linalg.norm(apart_m, axis=-1)
    found = error_mm.mean(), np.percentile(error_mm, 99), error_mm.max()
    return dict(zip(("mean_mm", "percentile_99_mm", "max_mm"), map(float, found), strict=True))


def _graph(
    model: Exportable, body: BodyModelData, about: Mapping[str, str], precision: Precision
) -> onnx.ModelProto:
    if isinstance(model, TrainedPlus):
        return plus_graph(model, body, about, precision)
    network, decoder = model.network, model.decoder
    return dsnet_body_graph(network, decoder, model.architecture, body, about, precision)


def _about(
    model: Exportable, body: BodyModelData, origin: DataOrigin, run: str, precision: Precision
) -> dict[str, str]:
    plus = isinstance(model, TrainedPlus)
    synthetic = "synthetic" in (origin, body.source)
    return {
        "run": run,
        "predictor": NAME if plus else model.network.name,
        "data": "synthetic" if synthetic else origin,
        "body": body.name,
        "gender": body.gender,
        "precision": precision,
        "fps": f"{FPS:g}",
        "up": "y",
        "units": "metres, radians",
        "joints": json.dumps(SMPL_JOINT_NAMES[:N_JOINTS]),
        "theta": "axis-angle of each joint relative to its parent, then the root's translation",
        "state": "zeros for a character that begins; then next_state of the frame before",
        "faces": base64.b64encode(body.faces.astype("<u4").tobytes()).decode("ascii"),
    }
