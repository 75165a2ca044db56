"""`dsnet_plus` in float64: the equations of `bridge.tissue.oscillators`, streams and training.

Plain and slow: every node's block is a matrix that is solved with, rest is Newton's method on all
offsets together, and gradients are steps into the imaginary direction, as `smpl` explains them.
Coefficients are the trained ones, which are float32; what is computed from them is float64.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from bridge.body import BodyModelData, load_body_model
from bridge.exchange.engine import Tensors, prefixed
from bridge.exchange.weights import KERAS_ADAM
from bridge.motion import unpack_theta
from bridge.paper import FPS
from bridge.tissue.oscillators import STEPS, SWEEPS
from bridge.tissue.shape import shape_features, shaped_normals
from bridge.tissue.trained_plus import TrainedPlus, shares_of_people
from dsnet.verify.reference import smpl
from dsnet.verify.reference.dsnet import Pass, train
from dsnet.verify.reference.layers import Array, Arrays

_NEWTON, _SOLVED = 100, 1e-13
_GRAVITY_M_S2 = np.array([0.0, -9.81, 0.0])
_QUIET_M, _QUIET_SHARE = 2e-4, 0.3
_PRIOR = {
    "omega": 1e-4, "damping_ratio": 1e-2, "stiffening": 3e-3, "sag": 3e-3, "normal_ratio": 3e-3,
    "wave_speed": 1e-2, "bending": 1e-2, "inertia_gain": 3e-2, "gravity_gain": 3e-2,
}  # fmt: skip
"""Of nodes' deviations from all nodes' mean."""
_GAINS, _PEOPLE = 3e-2, 3e-3
"""Of gains that are not 1, and of what people have besides their shape's."""


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Of K nodes of one person, (K, 1) each but for the normals: the letters of the equations."""

    omega: Array  # W, 1/s
    damping_ratio: Array  # Z
    stiffening: Array  # a, 1/m^2
    sag: Array  # m
    normal_ratio: Array  # p
    wave_speed: Array  # c, m/s
    bending: Array  # D, m^4/s^2
    inertia_gain: Array  # h
    gravity_gain: Array  # j
    normals: Array  # n, (K, 3), outward, in the rest pose

    @classmethod
    def of_logarithms(
        cls, logs: Mapping[str, Array], own: Array, power: Array, normals: Array
    ) -> Coefficients:
        """Of who has `own` (K, 1) of log W; log a follows it by `power`, sag as 1 / W^2."""
        person = {**logs, "omega": logs["omega"] + own}
        person["stiffening"] = logs["stiffening"] + power * own
        person["sag"] = logs["sag"] - 2 * own
        return cls(**{name: np.exp(log) for name, log in person.items()}, normals=normals)

    def load(self, inertia: Array, gravity: Array) -> Array:
        """(..., K, 3) load on the nodes."""
        return self.inertia_gain * inertia + self.gravity_gain * gravity


class Sheet:
    """The nodes of one person, of a dense Laplacian (K, K)."""

    def __init__(self, coefficients: Coefficients, laplacian: Array) -> None:
        exact = {name: np.float64(1) * array for name, array in vars(coefficients).items()}
        self._c = c = Coefficients(**exact)  # float32 or complex before
        across = c.normals[:, :, None] * c.normals[:, None, :]
        self._P = np.eye(3) + (c.normal_ratio - 1)[..., None] * across  # (K, 3, 3)
        self._s = c.sag * np.array([0.0, -1.0, 0.0])
        self._spring = c.omega**2 / (1 + 3 * c.stiffening * self._strain(self._s))  # w^2
        tension = c.wave_speed**2 * laplacian
        self._C = tension + c.bending * (laplacian @ laplacian)
        self._dt = 1 / (STEPS * FPS)
        absolute = np.where(np.real(self._C) < 0, -self._C, self._C)
        self._N = self._dt**2 / 4 * absolute.sum(1, keepdims=True)

    def frame(self, now: Array, before: Array, load: Array) -> tuple[Array, Array]:
        """Offsets (K, 3) a frame after `now`, and a step before that, under a load (K, 3)."""
        for _ in range(STEPS):
            before, now = now, self.step(now, before, load)
        return now, before

    def step(self, now: Array, before: Array, load: Array) -> Array:
        """Offsets (K, 3) a step after `now`, which followed `before`, metres."""
        c, square = self._c, self._dt**2
        drag, hardening = c.damping_ratio * c.omega * self._dt, self._spring * c.stiffening
        stiffer = square / 2 * hardening * self._strain(now + self._s)
        standing = square * hardening * self._strain(self._s) * self._stretched(self._s)
        twice = 2 * now + before
        known = square * load + 2 * now - before + drag * before + standing
        pulled = square / 4 * (self._spring * self._stretched(twice) + self._C @ twice)
        known = known - pulled - stiffer * self._stretched(before + 2 * self._s)
        blocks = (1 + drag + self._N)[..., None] * np.eye(3)
        blocks = blocks + (square / 4 * self._spring + stiffer)[..., None] * self._P
        after = 2 * now - before
        for _ in range(SWEEPS):
            left = known + self._N * after - square / 4 * self._C @ after
            after = np.linalg.solve(blocks, left[..., None])[..., 0]
        return after

    def settled(self, load: Array) -> Array:
        """(K, 3) at rest under a constant load (K, 3)."""
        c, count = self._c, len(load)
        coupled = np.kron(self._C, np.eye(3))
        offsets_m, load = np.zeros((count, 3)), np.asarray(load, np.float64)
        standing = self._spring * (1 + c.stiffening * self._strain(self._s))
        standing, size = standing * self._stretched(self._s), np.abs(self._s).max()
        for _ in range(_NEWTON):
            stretched = self._stretched(offsets_m + self._s)
            held = self._spring * (1 + c.stiffening * self._strain(offsets_m + self._s))
            missing = load + standing - held * stretched - self._C @ offsets_m
            rising = 2 * self._spring * c.stiffening * stretched
            blocks = held[..., None] * self._P + rising[:, :, None] * stretched[:, None, :]
            slope = coupled.copy()
            for node, block in enumerate(blocks):
                mine = slice(3 * node, 3 * node + 3)
                slope[mine, mine] += block
            moved = np.linalg.solve(slope, missing.ravel()).reshape(count, 3)
            offsets_m = offsets_m + moved
            if np.abs(moved).max() <= _SOLVED * max(np.abs(offsets_m).max(), size):
                return offsets_m
        raise ArithmeticError("tissue that does not come to rest")

    def _strain(self, away_m: Array) -> Array:
        """(K, 1) |v|_P^2."""
        return (away_m * self._stretched(away_m)).sum(1, keepdims=True)

    def _stretched(self, offsets_m: Array) -> Array:
        """P u."""
        return np.einsum("kxy,ky->kx", self._P, offsets_m)


def posed(model: TrainedPlus, body: BodyModelData, theta: Array, betas: Array) -> Array:
    """Vertices (T, V, 3), metres, as a stream of poses theta (T, 69) of one character gives them.

    It begins settled in the first pose; what is shown is `look_ahead` frames old, the first pose
    until then.
    """
    rows = np.maximum(np.arange(len(theta)) - model.look_ahead, 0)
    at_nodes, shown = moving(model, body, theta, betas)[rows], theta[rows]
    offsets_m = np.einsum("vk,tvkx->tvx", model.nodes.shares, at_nodes[:, model.nodes.owners])
    static_m = model.static_m(body, betas, shown)
    if static_m is not None:
        offsets_m = offsets_m + static_m
    return smpl.posed_vertices(body, betas[None], *unpack_theta(shown), offsets_m)


def moving(model: TrainedPlus, body: BodyModelData, theta: Array, betas: Array) -> Array:
    """(T, K, 3) offsets of the nodes over a motion theta (T, 69), which ends standing still."""
    person = coefficients(model, body, betas)
    loads = _loads(model, person, body, theta, betas)
    sheet = Sheet(person, model.nodes.laplacian.toarray().astype(np.float64))
    now = before = sheet.settled(loads[0])
    offsets_m, taps = [now], model.weights.taps.astype(np.float64)
    for frame in range(1, len(theta)):
        newest = frame - 1 + model.look_ahead
        known = loads[np.clip(newest - np.arange(len(taps)), 0, len(loads) - 1)]
        now, before = sheet.frame(now, before, np.tensordot(taps, known, 1))
        offsets_m.append(now)
    return np.stack(offsets_m)


def coefficients(model: TrainedPlus, body: BodyModelData, betas: Array) -> Coefficients:
    """What a `dsnet_plus` says of a person of shape betas (10,), known or new."""
    weights = model.weights
    features = shape_features(body, betas, model.nodes.vertices)
    shares = shares_of_people(betas, model.people_betas)
    own = features @ weights.slopes + np.tensordot(shares, weights.residual, 1)
    logs = {name: np.asarray(log, np.float64) for name, log in weights.base.items()}
    normals = shaped_normals(body, betas)[model.nodes.vertices]
    return Coefficients.of_logarithms(logs, own, weights.stiffening_power, normals)


def _loads(
    model: TrainedPlus, person: Coefficients, body: BodyModelData, theta: Array, betas: Array
) -> Array:
    """(T, K, 3) loads: the first and last frame, which have no acceleration, stand still.

    Skinning weights that sum to 1 only up to rounding are made to: standing is no turn exactly.
    """
    pose, trans = unpack_theta(np.asarray(theta, np.float64))
    vertices, turned = model.nodes.vertices, smpl.rotations(pose)
    turns, shift = smpl.skinning(body, betas[None], turned, trans, vertices)
    turns = turns + (1 - body.weights[vertices].sum(1))[:, None, None] * np.eye(3)
    rest = smpl.rest_vertices(body, betas[None], turned, vertices)
    places = (turns @ rest[..., None])[..., 0] + shift
    acceleration = np.zeros_like(places)
    acceleration[1:-1] = (places[2:] - 2 * places[1:-1] + places[:-2]) * FPS**2
    back = turns.swapaxes(-1, -2)
    inertia = -(back @ acceleration[..., None])[..., 0]
    return person.load(inertia, back @ _GRAVITY_M_S2 - _GRAVITY_M_S2)


def predict(w: Arrays, given: Arrays) -> Array:
    """Offsets (T, K, B, 3) of B windows, from weights named as the Keras layer's and a batch."""
    return np.stack([_window(w, given, clip) for clip in range(given["now"].shape[1])], axis=2)


def learn(w: Arrays, given: Arrays) -> Pass:
    """Loss, and the gradient of it and the prior by every number of every weight."""
    gradients = {}
    for name, values in w.items():
        slopes = np.zeros(values.size)
        for place in range(values.size):
            moved = values.astype(np.complex128)
            moved.flat[place] += 1j * smpl.H
            other = {**w, name: moved}
            total = _loss(predict(other, given), given) + _prior(other)
            slopes[place] = np.imag(total) / smpl.H
        gradients[name] = slopes.reshape(values.shape)
    offsets = predict(w, given)
    return Pass(float(_loss(offsets, given)), gradients, {}, {"offsets": offsets})


def _window(w: Arrays, given: Arrays, clip: int) -> Array:
    """(T, K, 3)."""
    own = given["features"][:, clip] @ w["slopes"]
    besides = w["residual"] - w["residual"].mean(0)
    own = own + np.tensordot(given["shares"][clip], besides, 1)  # (K, 1)
    logs = {name: w[f"log_{name}"] + w[f"by_node_{name}"] for name in _PRIOR}
    normals = given["normals"][:, clip]
    normals = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
    person = Coefficients.of_logarithms(logs, own, w["stiffening_power"], normals)
    loads = person.load(given["inertia"][:, :, clip], given["gravity"][:, :, clip])
    sheet, taps, found = Sheet(person, given["laplacian"]), w["taps"] / w["taps"].sum(), []
    now, before = given["now"][:, clip], given["before"][:, clip]
    for newest in range(len(taps) - 1, len(loads)):
        load = np.tensordot(taps, loads[newest - np.arange(len(taps))], 1)
        now, before = sheet.frame(now, before, load)
        found.append(now)
    return np.stack(found)


def _loss(found: Array, given: Arrays) -> Array:
    """The share of the energy that is missed, and some of each window's own share."""
    counted, target = given["counted"], given["target"]
    missed, energy = ((counted * values**2).mean((0, 1, 3)) for values in (found - target, target))
    quiet = counted.mean((0, 1, 3)) * _QUIET_M**2
    return missed.sum() / energy.sum() + _QUIET_SHARE * (missed / (energy + quiet)).mean()


def _prior(w: Arrays) -> Array:
    """Nodes are alike, people follow their shape, and gains are 1."""
    uneven = sum(weight * (w[f"by_node_{name}"] ** 2).mean() for name, weight in _PRIOR.items())
    gains = sum((w[f"log_{name}"] ** 2).sum() for name in ("inertia_gain", "gravity_gain"))
    return uneven + _GAINS * gains + _PEOPLE * (w["residual"] ** 2).mean()


def oscillators_train(w: Arrays, steps: list[int], learning_rate: float, **given: Array) -> Tensors:
    """Offsets of windows, loss, gradients, steps of Adam."""
    rule = replace(KERAS_ADAM, learning_rate=learning_rate, beta_2=0.95)
    offsets = prefixed("layer", {"offsets": predict(w, given)})
    return offsets | train(w, lambda now: learn(now, given), rule, steps)


def plus_graph(w: Arrays, theta: Array, betas: Array, body: str) -> Tensors:
    """From poses theta (T, B, 69) of B characters to the posed skin, by `dsnet_plus`."""
    model, data = TrainedPlus.from_arrays(w), load_body_model(body)
    characters = zip(theta.swapaxes(0, 1), betas, strict=True)
    clips = [posed(model, data, own, shape) for own, shape in characters]
    return {"layer/vertices": np.stack(clips, axis=1)}
