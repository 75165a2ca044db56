"""`dsnet_plus` in float64, frame by frame: loads, the sheet of oscillators, the posed skin.

Coefficients are the trained ones, which are float32; all that is computed from them is float64.
"""

from __future__ import annotations

import numpy as np

from bridge.body import BodyModelData, pose_vertices
from bridge.body.posing import joint_rotations, joint_transforms, pose_features, shaped_joints
from bridge.motion import unpack_theta
from bridge.tissue.oscillators import FPS
from bridge.tissue.shape import shape_features, shaped_normals
from bridge.tissue.trained_plus import TrainedPlus, shares_of_people
from bridge.verify.reference.oscillators import Coefficients, Sheet

_GRAVITY_M_S2 = np.array([0.0, -9.81, 0.0])


def posed(
    model: TrainedPlus, body: BodyModelData, theta: np.ndarray, betas: np.ndarray
) -> np.ndarray:
    """Vertices (T, V, 3), metres, as a stream of poses theta (T, 69) of one character gives them.

    She begins settled in her first pose; what is shown is `look_ahead` frames old, her first pose
    until then.
    """
    rows = np.maximum(np.arange(len(theta)) - model.look_ahead, 0)
    offsets_m = _as_vertices(model, moving(model, body, theta, betas)[rows])
    shown = theta[rows]
    static_m = model.static_m(body, betas, shown)
    if static_m is not None:
        offsets_m = offsets_m + static_m
    return pose_vertices(body, np.tile(betas, (len(theta), 1)), *unpack_theta(shown), offsets_m)


def moving(
    model: TrainedPlus, body: BodyModelData, theta: np.ndarray, betas: np.ndarray
) -> np.ndarray:
    """(T, K, 3) offsets of the nodes over a motion theta (T, 69), which ends standing still."""
    person = coefficients(model, body, betas)
    felt = _felt(model, person, body, theta, betas)
    sheet = Sheet(person, model.nodes.laplacian.toarray().astype(np.float64))
    now = before = sheet.settled(felt[0])
    offsets_m = [now]
    for frame in range(1, len(theta)):
        newest = frame - 1 + model.look_ahead
        known = [
            felt[np.clip(newest - late, 0, len(felt) - 1)]
            for late in range(len(model.weights.taps))
        ]
        load = np.tensordot(model.weights.taps.astype(np.float64), known, 1)
        now, before = sheet.frame(now, before, load)
        offsets_m.append(now)
    return np.stack(offsets_m)


def coefficients(model: TrainedPlus, body: BodyModelData, betas: np.ndarray) -> Coefficients:
    """What a `dsnet_plus` says of a person of shape betas (10,), known or new."""
    weights = model.weights
    features = shape_features(body, betas, model.nodes.vertices)
    shares = shares_of_people(betas, model.people_betas)
    own = features @ weights.slopes + np.tensordot(shares, weights.residual, 1)
    logs = {name: np.asarray(log, np.float64) for name, log in weights.base.items()}
    logs["omega"] = logs["omega"] + own
    logs["stiffening"] = logs["stiffening"] + weights.stiffening_power * own
    normals = shaped_normals(body, betas)[model.nodes.vertices]
    return Coefficients(**{name: np.exp(log) for name, log in logs.items()}, normals=normals)


def _felt(
    model: TrainedPlus,
    person: Coefficients,
    body: BodyModelData,
    theta: np.ndarray,
    betas: np.ndarray,
) -> np.ndarray:
    """(T, K, 3) loads: the first and last frame, which have no acceleration, stand still."""
    places, turns = _skinned(body, model.nodes.vertices, theta, betas)
    acceleration = np.zeros_like(places)
    acceleration[1:-1] = (places[2:] - 2 * places[1:-1] + places[:-2]) * FPS**2
    back = turns.swapaxes(-1, -2)
    inertia = -(back @ acceleration[..., None])[..., 0]
    gravity = back @ _GRAVITY_M_S2 - _GRAVITY_M_S2
    return person.inertia_gain * inertia + person.gravity_gain * gravity


def _skinned(
    body: BodyModelData, vertices: np.ndarray, theta: np.ndarray, betas: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Places (T, K, 3) of some vertices and what turns them (T, K, 3, 3).

    Weights that sum to 1 only up to rounding are made to: standing is no turn exactly.
    """
    pose, trans = unpack_theta(np.asarray(theta, np.float64))
    rotations = joint_rotations(body, pose)
    joints = np.tile(shaped_joints(body, betas[None]), (len(pose), 1, 1))
    bones = joint_transforms(rotations, joints, body.parents, trans)
    weights = body.weights[vertices]
    blended = np.einsum("kj,tjxy->tkxy", weights, bones[..., :3, :])
    blended += (1 - weights.sum(1))[:, None, None] * np.eye(3, 4)
    rest = body.v_template[vertices] + body.shapedirs[vertices] @ betas
    rest = rest + np.einsum("vxp,tp->tvx", body.posedirs[vertices], pose_features(rotations))
    turns = blended[..., :3]
    return (turns @ rest[..., None])[..., 0] + blended[..., 3], turns


def _as_vertices(model: TrainedPlus, at_nodes: np.ndarray) -> np.ndarray:
    """(T, V, 3) of (T, K, 3)."""
    return np.einsum("vk,tvkx->tvx", model.nodes.shares, at_nodes[:, model.nodes.owners])
