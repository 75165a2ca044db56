"""`dsnet_plus` in float64, frame by frame: loads, the sheet of oscillators, the posed skin.

Coefficients are the trained ones, which are float32; all that is computed from them is float64.
"""

from __future__ import annotations

import numpy as np

from bridge.body import BodyModelData, pose_vertices
from bridge.motion import unpack_theta
from bridge.tissue.load import GRAVITY_M_S2, SkinnedNodes
from bridge.tissue.oscillators import FPS, OscillatorSheet
from bridge.tissue.trained_plus import TrainedPlus


def posed(
    model: TrainedPlus, body: BodyModelData, theta: np.ndarray, betas: np.ndarray
) -> np.ndarray:
    """Vertices (T, V, 3), metres, as a stream of poses theta (T, 69) of one character gives them.

    She begins settled in her first pose; what is shown is `look_ahead` frames old, her first pose
    until then.
    """
    offsets_m = _as_vertices(model, _at_nodes(model, body, theta, betas))
    shown = theta[np.maximum(np.arange(len(theta)) - model.look_ahead, 0)]
    static_m = model.static_m(body, betas, shown)
    if static_m is not None:
        offsets_m = offsets_m + static_m
    return pose_vertices(body, np.tile(betas, (len(theta), 1)), *unpack_theta(shown), offsets_m)


def _at_nodes(
    model: TrainedPlus, body: BodyModelData, theta: np.ndarray, betas: np.ndarray
) -> np.ndarray:
    """(T, K, 3) after each pose."""
    mechanics = model.mechanics(body, betas)
    places, turns = SkinnedNodes(body, model.nodes.vertices, betas)(theta)
    acceleration = np.zeros_like(places)
    acceleration[1:-1] = (places[2:] - 2 * places[1:-1] + places[:-2]) * FPS**2
    inertia = -np.einsum("tkx,tkxy->tky", acceleration, turns)
    gravity = np.einsum("x,tkxy->tky", GRAVITY_M_S2, turns) - GRAVITY_M_S2
    felt = mechanics.inertia_gain * inertia + mechanics.gravity_gain * gravity
    sheet = OscillatorSheet(mechanics, model.nodes.laplacian)
    now = before = sheet.settled(felt[0]).astype(np.float64)
    offsets_m = []
    for frame in range(len(theta)):
        known = [felt[max(frame - 1 - late, 0)] for late in range(len(mechanics.taps))]
        load = np.tensordot(mechanics.taps.astype(np.float64), known, 1)
        now, before = sheet.frame(now, before, load)
        offsets_m.append(now)
    return np.stack(offsets_m)


def _as_vertices(model: TrainedPlus, at_nodes: np.ndarray) -> np.ndarray:
    """(T, V, 3) of (T, K, 3)."""
    return np.einsum("vk,tvkx->tvx", model.nodes.shares, at_nodes[:, model.nodes.owners])
