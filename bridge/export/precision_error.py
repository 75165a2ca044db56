"""What fewer bits cost: the same motion by two graphs of one predictor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import onnx
from numpy.typing import NDArray

from bridge.paper import N_BETAS, THETA_SIZE
from bridge.runtime.onnx_graph import GraphSession

FRAMES, FPS = 60, 60.0
"""One second."""
_BEND_RAD, _HOP_M = 0.6, 0.25


@dataclass(frozen=True)
class PrecisionError:
    """Distances of vertices from those in float32, millimetres."""

    mean_mm: float
    percentile_99_mm: float
    max_mm: float


def precision_error(exact: onnx.ModelProto, reduced: onnx.ModelProto) -> PrecisionError:
    """Errors over a second of three different bodies that hop and swing all of their joints."""
    theta, betas = _hopping()
    apart = _clip(reduced, theta, betas) - _clip(exact, theta, betas)
    error_mm = 1e3 * np.linalg.norm(apart, axis=-1)
    return PrecisionError(
        float(error_mm.mean()), float(np.percentile(error_mm, 99)), float(error_mm.max())
    )


def _hopping() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """theta (T, B, 69) and betas (B, 10)."""
    betas = np.stack([np.full(N_BETAS, size) for size in (-1.0, 0.0, 1.0)])
    times_s = np.arange(FRAMES)[:, None, None] / FPS
    joint = np.arange(THETA_SIZE)
    phase = 2.4 * np.arange(len(betas))[:, None] + 1.7 * joint
    theta = _BEND_RAD * np.sin(7 * times_s + phase) * np.cos(joint)
    theta[..., -3:] = 0
    theta[..., -2] = _HOP_M * np.abs(np.sin(8 * times_s[..., 0]))
    return theta.astype(np.float32), betas.astype(np.float32)


def _clip(model: onnx.ModelProto, theta: NDArray, betas: NDArray) -> NDArray[np.float32]:
    """(T, B, V, 3)."""
    run, frames = GraphSession(model), []
    state = np.zeros((len(betas), run.input_shapes["state"][1]), np.float32)
    for poses in theta:
        found = run(theta=poses, betas=betas, state=state)
        state = found["next_state"]
        frames.append(found["vertices"])
    return np.stack(frames)
