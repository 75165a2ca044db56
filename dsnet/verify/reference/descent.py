"""The paper's descent (Section 3.3) in float64: momentum on the unsquared distance of two meshes.

The gradient by vertices, bones and blend shapes is written out; that of bones and blend shapes by
the variables is taken by complex steps, as in `smpl`.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from bridge.body import BodyModelData, load_body_model
from bridge.exchange.engine import Tensors, prefixed
from dsnet.verify.reference import smpl
from dsnet.verify.reference.layers import Array, Arrays

RATE, MOMENTUM = 1e-4, 0.9
"""The paper's, of steps over radians and metres."""


class MeshDistance:
    """|| W(T + M_S(beta) + M_P(theta)) - S ||_2 of B bodies from a mesh (B, V, 3) each."""

    def __init__(self, body: BodyModelData, mesh: Array) -> None:
        self._body, self._mesh = body, mesh
        self._rest = smpl.joints(body, np.zeros((1, 10)))
        self._rest_by_betas = smpl.joints(body, np.eye(10)) - self._rest

    def gradient(self, fixed: Arrays, variables: Arrays) -> tuple[Array, Arrays]:
        """Distances (B,), metres, and their derivatives by `variables`.

        Both sets together are `betas` (B, 10), `pose` (B, 22, 3) and `trans` (B, 3).
        """
        given, body, count = {**fixed, **variables}, self._body, len(self._mesh)
        turns = smpl.rotations(given["pose"])
        turn, shift = smpl.skinning(body, given["betas"], turns, given["trans"])
        rest = smpl.rest_vertices(body, given["betas"], turns)
        residual = smpl.applied(turn, rest) + shift - self._mesh
        distances = np.sqrt((residual**2).sum((1, 2)))
        by_vertex = residual / distances[:, None, None]
        by_rest = smpl.applied(turn.swapaxes(-1, -2), by_vertex).reshape(count, -1)
        by_turn = (by_vertex[..., None] * rest[..., None, :]).reshape(count, -1, 9)
        linear = {
            "turn": body.weights.T @ by_turn,
            "shift": body.weights.T @ by_vertex,
            "features": by_rest @ body.posedirs.reshape(by_rest.shape[1], -1),
            "betas": by_rest @ body.shapedirs.reshape(by_rest.shape[1], -1),
        }
        slopes = [
            self._by_variables(
                {name: array[row] for name, array in linear.items()},
                {name: array[row] for name, array in given.items()},
            )
            for row in range(count)
        ]
        return distances, {name: np.stack([row[name] for row in slopes]) for name in variables}

    def _by_variables(self, linear: Arrays, given: Arrays) -> Arrays:
        """Derivatives by a body's variables of what `linear` multiplies, summed."""

        def by(name: str) -> Array:
            shape = given[name].shape
            moved = {key: array[None] for key, array in given.items()}
            directions = np.eye(math.prod(shape)).reshape(-1, *shape)
            moved[name] = moved[name] + 1j * smpl.H * directions
            return (np.imag(self._sum(linear, **moved)) / smpl.H).reshape(shape)

        return {name: by(name) for name in given}

    def _sum(self, linear: Arrays, betas: Array, pose: Array, trans: Array) -> Array:
        turns = smpl.rotations(pose)
        rest = self._rest + np.tensordot(betas, self._rest_by_betas, 1)
        turn, shift = smpl.bones(self._body, rest, turns, trans)
        features = turns[:, 1:].reshape(len(turns), -1)
        return (
            (turn.reshape(len(turn), -1, 9) * linear["turn"]).sum((1, 2))
            + (shift * linear["shift"]).sum((1, 2))
            + features @ linear["features"]
            + betas @ linear["betas"]
        )


def rigid_start(body: BodyModelData, mesh: Array) -> Arrays:
    """The mean body in the rest pose, turned and moved as a whole to each mesh (B, V, 3)."""
    betas, pose = np.zeros((len(mesh), 10)), np.zeros((len(mesh), 22, 3))
    root = smpl.joints(body, betas)[:, 0]
    template, centres = body.v_template - body.v_template.mean(0), mesh.mean(1)
    turns = [Rotation.align_vectors(one - one.mean(0), template)[0] for one in mesh]
    pose[:, 0] = [turn.as_rotvec() for turn in turns]
    from_root = body.v_template.mean(0) - root
    turned = [turn.apply(arm) for turn, arm in zip(turns, from_root, strict=True)]
    return {"betas": betas, "pose": pose, "trans": centres - turned - root}


def descend(distance: MeshDistance, fixed: Arrays, start: Arrays, steps: int) -> Arrays:
    """Of the first `steps` iterates, the start among them, each body's closest."""
    now, best = start, {name: array.copy() for name, array in start.items()}
    velocity = {name: np.zeros_like(array) for name, array in start.items()}
    smallest = np.full(len(next(iter(start.values()))), np.inf)
    for _ in range(steps):
        distances, slopes = distance.gradient(fixed, now)
        closer = distances < smallest
        smallest = np.where(closer, distances, smallest)
        for name, array in now.items():
            best[name][closer] = array[closer]
        velocity = {name: MOMENTUM * velocity[name] + slopes[name] for name in now}
        now = {name: now[name] - RATE * velocity[name] for name in now}
    return best


def descent(body: str, mesh: Array, steps: int, **start: Array) -> Tensors:
    """The closest iterates of a descent to meshes, and their distances.

    It fits pose and translation from `start` at its betas, or, without a start, the shape too.
    PyTorch has two descents, the reference one.
    """
    data = load_body_model(body)
    begin = {**start} if start else rigid_start(data, mesh)
    fixed = {"betas": begin.pop("betas")} if start else {}
    found = descend(MeshDistance(data, mesh), fixed, begin, steps)
    posed = smpl.posed_vertices(data, **{**fixed, **found})
    distances = np.sqrt(((posed - mesh) ** 2).sum((1, 2)))
    found = {**found, "distances": distances}
    return prefixed("descent", found) | prefixed("stock descent", found)
