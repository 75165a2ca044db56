"""SMPL (Eq. 1-2) in float64, and its gradient by complex-step differentiation.

f'(x) = Im f(x + i h) / h: with h = 1e-30 nothing cancels, so derivatives are exact to rounding
without any formula. All functions accept complex numbers.
"""

from __future__ import annotations

import math

import numpy as np

from bridge.body import BodyModelData, load_body_model
from bridge.exchange.engine import Tensors, prefixed
from dsnet.verify.reference.layers import Array, Arrays

H = 1e-30
_ALL = slice(None)


def rotations(pose: Array) -> Array:
    """Rotation matrices (B, 24, 3, 3) of axis-angle vectors (B, 22 or 24, 3), radians.

    With 22 joints, the hands are not rotated.
    """
    hands = np.zeros((len(pose), 24 - pose.shape[1], 3))
    x, y, z = np.moveaxis(np.concatenate([pose, hands], axis=1), -1, 0)
    angle, o = np.sqrt(x**2 + y**2 + z**2)[..., None, None], np.zeros_like(x)
    cross = np.stack([o, -z, y, z, o, -x, -y, x, o], axis=-1).reshape(*x.shape, 3, 3)
    half = np.sinc(angle / (2 * np.pi))  # sin(a / 2) / (a / 2), and 1 at 0
    return np.eye(3) + np.sinc(angle / np.pi) * cross + half**2 / 2 * cross @ cross


def joints(body: BodyModelData, betas: Array) -> Array:
    """Joints (B, 24, 3) in the rest pose for betas (B, 10), metres."""
    return body.J_regressor.toarray() @ (body.v_template + _blended(body.shapedirs, betas))


def rest_vertices(
    body: BodyModelData, betas: Array, turns: Array, vertices: Array | slice = _ALL
) -> Array:
    """Vertices (B, V, 3) before skinning, with shape and pose blend shapes, metres."""
    features = (turns[:, 1:] - np.eye(3)).reshape(len(turns), -1)
    shaped = body.v_template[vertices] + _blended(body.shapedirs[vertices], betas)
    return shaped + _blended(body.posedirs[vertices], features)


def bones(body: BodyModelData, rest: Array, turns: Array, trans: Array) -> tuple[Array, Array]:
    """Linear part (B, 24, 3, 3) and translation (B, 24, 3) of each bone's transform.

    `rest` (B, 24, 3) are the joints in the rest pose. The root rotates about its own joint and is
    then moved by `trans` (B, 3).
    """
    turned, places = [turns[:, 0]], [rest[:, 0] + trans]
    for joint, parent in list(enumerate(body.parents))[1:]:
        places.append(places[parent] + applied(turned[parent], rest[:, joint] - rest[:, parent]))
        turned.append(turned[parent] @ turns[:, joint])
    turn = np.stack(turned, axis=1)
    return turn, np.stack(np.broadcast_arrays(*places), axis=1) - applied(turn, rest)


def skinning(
    body: BodyModelData, betas: Array, turns: Array, trans: Array, vertices: Array | slice = _ALL
) -> tuple[Array, Array]:
    """Linear part (B, V, 3, 3) and translation (B, V, 3) of each vertex's skinning transform."""
    turn, shift = bones(body, joints(body, betas), turns, trans)
    weights = body.weights[vertices]
    return (weights @ turn.reshape(-1, 24, 9)).reshape(-1, len(weights), 3, 3), weights @ shift


def posed_vertices(
    body: BodyModelData, betas: Array, pose: Array, trans: Array, offsets: Array | float = 0.0
) -> Array:
    """Posed vertices (B, V, 3), metres; offsets (B, V, 3) are added in the rest pose."""
    turns = rotations(pose)
    turn, shift = skinning(body, betas, turns, trans)
    return applied(turn, rest_vertices(body, betas, turns) + offsets) + shift


def unposed_vertices(
    body: BodyModelData, mesh: Array, betas: Array, pose: Array, trans: Array
) -> Array:
    """Rest-pose vertices (B, V, 3) of a posed mesh, metres: inverse skinning, W^-1 of Eq. 5."""
    turn, shift = skinning(body, betas, rotations(pose), trans)
    return np.linalg.solve(turn, (mesh - shift)[..., None])[..., 0]


def gradient(body: BodyModelData, given: Arrays, probe: Array) -> Arrays:
    """Gradients of sum(probe * vertices) for betas, pose, trans, offsets; probe is (B, V, 3)."""

    def by(name: str, row: int) -> Array:
        moved = {key: array[row : row + 1] for key, array in given.items()}
        shape = moved[name].shape[1:]
        size = math.prod(shape)
        moved[name] = moved[name] + 1j * H * np.eye(size).reshape(size, *shape)
        slopes = np.tensordot(posed_vertices(body, **moved), probe[row], 2)
        return (np.imag(slopes) / H).reshape(shape)

    turn, _shift = skinning(body, given["betas"], rotations(given["pose"]), given["trans"])
    names, rows = ("betas", "pose", "trans"), range(len(probe))
    slopes = {name: np.stack([by(name, row) for row in rows]) for name in names}
    return {**slopes, "offsets": applied(turn.swapaxes(-1, -2), probe)}


def smpl(body: str, mesh: Array, probe: Array, **given: Array) -> Tensors:
    """Parts of the forward pass, `mesh` (B, V, 3) unposed, and gradients."""
    data, betas, turns = load_body_model(body), given["betas"], rotations(given["pose"])
    motion = {name: given[name] for name in ("betas", "pose", "trans")}
    outputs = {
        "rotations": turns,
        "joints": joints(data, betas),
        "rest_vertices": rest_vertices(data, betas, turns),
        "vertices": posed_vertices(data, **given),
        "unposed": unposed_vertices(data, mesh, **motion),
    }
    return prefixed("layer", outputs) | prefixed("grad", gradient(data, given, probe))


def _blended(shapes: Array, amounts: Array) -> Array:
    """Sum (B, V, 3) of blend shapes (V, 3, N) with coefficients (B, N)."""
    flat = amounts @ shapes.reshape(-1, shapes.shape[-1]).T
    return flat.reshape(len(amounts), *shapes.shape[:-1])


def applied(matrices: Array, vectors: Array) -> Array:
    """Products (..., 3) of matrices (..., 3, 3) and vectors (..., 3)."""
    return np.einsum("...xy,...y->...x", matrices, vectors)
