"""A predictor with its body as one `.onnx` file that ONNX Runtime alone can run.

The file's metadata say all that a user must know to feed it. Inputs, outputs and state are
described in `dsnet.onnx.plus_graph` and, for DSNet, in `dsnet.onnx.network_graphs`.
"""

from __future__ import annotations

import base64
import json
from pathlib import Path

import numpy as np
import onnx

from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.errors import DsnetError
from bridge.paper import FPS, N_JOINTS, THETA_SIZE
from dsnet.onnx.onnx_graph import GraphSession
from dsnet.onnx.precision import PRECISIONS, Precision
from dsnet.prediction.load_model import TrainedModel

_BEND_RAD, _HOP_M = 0.6, 0.25


def export_onnx(
    path: Path, chosen: TrainedModel, *, run: str = "", precision: Precision = "float32"
) -> None:
    """Write one predictor with the body that it moves to a new path.

    Takes a second, or about ten with fewer bits than float32.

    Parameters
    ----------
    run : name of the predictor's run, for the metadata.
    precision : of the large kernels (`dsnet.onnx.onnx_graph`). The error of fewer bits is
        measured and written into the metadata `error_mm`, see `precision_error_mm`.

    Raises
    ------
    DsnetError
        If there is no such precision, or predictor and body do not fit.
    """
    if precision not in PRECISIONS:
        expected = f"one of {', '.join(PRECISIONS)}"
        raise DsnetError(f"precision {precision!r}", expected, "Name one of these.")
    graph = chosen.model.graph(_metadata(chosen, run, precision), precision)
    if precision != "float32":
        error_mm = precision_error_mm(chosen.model.graph({}, "float32"), graph)
        rounded = json.dumps({name: round(mm, 4) for name, mm in error_mm.items()})
        graph.metadata_props.add(key="error_mm", value=rounded)
    onnx.save_model(graph, path)


def export_onnx_clip(path: Path, chosen: TrainedModel, *, run: str = "") -> None:
    """Write one predictor with its body as a graph of whole clips, from their first frame on."""
    onnx.save_model(chosen.model.clip_graph(_metadata(chosen, run, "float32")), path)


def export_onnx_plain(path: Path, chosen: TrainedModel, *, run: str = "") -> None:
    """Write one predictor as graphs without `If`, `Loop` and `Scan`, for runtimes that lack them.

    The new folder has `step.onnx`, with the offsets beside the vertices, and, where a state does
    not begin as zeros, `begin.onnx`, which gives that of characters who begin.
    """
    path.mkdir()
    for name, graph in chosen.model.plain_graphs(_metadata(chosen, run, "float32")).items():
        onnx.save_model(graph, path / f"{name}.onnx")


def precision_error_mm(exact: onnx.ModelProto, reduced: onnx.ModelProto) -> dict[str, float]:
    """Distances between the vertices of two graphs of a predictor: the error of fewer bits.

    They are measured on one motion, in which three different bodies hop and swing all of their
    joints for a second.
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
    difference_m = GraphSession(reduced).rollout(theta, betas) - session.rollout(theta, betas)
    error_mm = 1e3 * np.linalg.norm(difference_m, axis=-1)
    statistics = error_mm.mean(), np.percentile(error_mm, 99), error_mm.max()
    return dict(zip(("mean_mm", "percentile_99_mm", "max_mm"), map(float, statistics), strict=True))


def _metadata(chosen: TrainedModel, run: str, precision: Precision) -> dict[str, str]:
    body = chosen.body
    return {
        "run": run,
        "predictor": chosen.name,
        "data": "synthetic" if body.source == "synthetic" else chosen.shows,
        "body": body.name,
        "gender": body.gender,
        "precision": precision,
        "fps": f"{FPS:g}",
        "up": "y",
        "units": "metres, radians",
        "joints": json.dumps(SMPL_JOINT_NAMES[:N_JOINTS]),
        "theta": "axis-angle of each joint relative to its parent, then the root's translation",
        "state": "zeros for a character that begins, or that a cut puts elsewhere; then next_state "
        "of the frame before",
        "faces": base64.b64encode(body.faces.astype("<u4").tobytes()).decode("ascii"),
    }
