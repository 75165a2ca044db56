"""`dsnet_plus` in float64: the equations of `bridge.tissue.oscillators`, streams and training.

Plain and slow: each node's block is solved as a 3 x 3 matrix, the equilibrium by Newton's method on
all offsets together, and gradients by complex steps (see `smpl`). Trained coefficients are float32;
everything computed from them is float64.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from bridge.body import BodyModelData, load_body_model
from bridge.body.posing import shaped_vertices
from bridge.body.surface_operators import vertex_normals
from bridge.exchange.engine import Tensors, prefixed
from bridge.exchange.weights import KERAS_ADAM
from bridge.motion import unpack_theta
from bridge.paper import FPS
from bridge.tissue.oscillators import STEPS, SWEEPS
from bridge.tissue.shape import shape_measures
from bridge.tissue.trained_plus import TrainedPlus, known_person, shares_of_people
from dsnet.verify.reference import smpl
from dsnet.verify.reference.dsnet import Pass, train
from dsnet.verify.reference.layers import Array, Arrays

_NEWTON, _SOLVED = 100, 1e-13
_GRAVITY_M_S2 = np.array([0.0, -9.81, 0.0])
_STEP, _STENCIL = 1e-3, {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12}
"""Of differences; shares of the values at so many steps."""
_QUIET_M, _QUIET_SHARE = 2e-4, 0.3
_PRIOR = {
    "omega": 1e-4, "damping_ratio": 1e-2, "stiffening": 3e-3, "sag": 3e-3, "normal_ratio": 3e-3,
    "wave_speed": 1e-2, "bending": 1e-2, "inertia_gain": 3e-2, "gravity_gain": 3e-2,
}  # fmt: skip
"""Weights of the prior on each node's deviation from the mean of all nodes."""
_GAINS, _PEOPLE = 3e-2, 3e-3
"""Weights of the prior on gains that differ from 1, and on subjects' residuals."""


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Coefficients of K nodes for one shape, (K, 1) each but for the normals.

    The comments give the letters of the equations.
    """

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
        cls, logs: Mapping[str, Array], log_omega: Array, power: Array, normals: Array
    ) -> Coefficients:
        """Add a shape's `log_omega` (K, 1) to log W; log a changes by `power` times it.

        The sag changes as 1 / W^2.
        """
        shaped = {**logs, "omega": logs["omega"] + log_omega}
        shaped["stiffening"] = logs["stiffening"] + power * log_omega
        shaped["sag"] = logs["sag"] - 2 * log_omega
        return cls(**{name: np.exp(log) for name, log in shaped.items()}, normals=normals)

    def load(self, inertia: Array, gravity: Array) -> Array:
        """(..., K, 3) load on the nodes."""
        return self.inertia_gain * inertia + self.gravity_gain * gravity


class Oscillators:
    """The coupled nodes of one body; the Laplacian is dense (K, K)."""

    def __init__(self, coefficients: Coefficients, laplacian: Array) -> None:
        # The product makes float32 float64 and leaves complex numbers complex.
        exact = {name: np.float64(1) * array for name, array in vars(coefficients).items()}
        self._c = c = Coefficients(**exact)
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
        """Offsets (K, 3) one frame after `now`, and those one step earlier, under a load (K, 3)."""
        for _ in range(STEPS):
            before, now = now, self.step(now, before, load)
        return now, before

    def step(self, now: Array, before: Array, load: Array) -> Array:
        """Offsets (K, 3) one step after `now`, which follows `before`, metres."""
        c, square = self._c, self._dt**2
        drag, hardening = c.damping_ratio * c.omega * self._dt, self._spring * c.stiffening
        stiffer = square / 2 * hardening * self._strain(now + self._s)
        preload = square * hardening * self._strain(self._s) * self._times_P(self._s)
        twice = 2 * now + before
        known = square * load + 2 * now - before + drag * before + preload
        elastic = square / 4 * (self._spring * self._times_P(twice) + self._C @ twice)
        known = known - elastic - stiffer * self._times_P(before + 2 * self._s)
        blocks = (1 + drag + self._N)[..., None] * np.eye(3)
        blocks = blocks + (square / 4 * self._spring + stiffer)[..., None] * self._P
        after = 2 * now - before
        for _ in range(SWEEPS):
            right_side = known + self._N * after - square / 4 * self._C @ after
            after = np.linalg.solve(blocks, right_side[..., None])[..., 0]
        return after

    def settled(self, load: Array) -> Array:
        """Equilibrium offsets (K, 3) under a constant load (K, 3), by Newton's method."""
        c, count = self._c, len(load)
        coupled = np.kron(self._C, np.eye(3))
        offsets_m, load = np.zeros((count, 3)), np.asarray(load, np.float64)
        preload = self._spring * (1 + c.stiffening * self._strain(self._s))
        preload, size = preload * self._times_P(self._s), np.abs(self._s).max()
        for _ in range(_NEWTON):
            direction = self._times_P(offsets_m + self._s)
            stiffness = self._spring * (1 + c.stiffening * self._strain(offsets_m + self._s))
            residual = load + preload - stiffness * direction - self._C @ offsets_m
            growth = 2 * self._spring * c.stiffening * direction
            blocks = stiffness[..., None] * self._P + growth[:, :, None] * direction[:, None, :]
            jacobian = coupled.copy()
            for node, block in enumerate(blocks):
                rows = slice(3 * node, 3 * node + 3)
                jacobian[rows, rows] += block
            change = np.linalg.solve(jacobian, residual.ravel()).reshape(count, 3)
            offsets_m = offsets_m + change
            if np.abs(change).max() <= _SOLVED * max(np.abs(offsets_m).max(), size):
                return offsets_m
        raise ArithmeticError("tissue that does not come to rest")

    def _strain(self, away_m: Array) -> Array:
        """(K, 1) |v|_P^2."""
        return (away_m * self._times_P(away_m)).sum(1, keepdims=True)

    def _times_P(self, offsets_m: Array) -> Array:
        """P u."""
        return np.einsum("kxy,ky->kx", self._P, offsets_m)


def posed_vertices(model: TrainedPlus, body: BodyModelData, theta: Array, betas: Array) -> Array:
    """Vertices (T, V, 3), metres, that a stream gives for poses theta (T, 69) of one character.

    It starts in equilibrium in the first pose. Output lags by `look_ahead` frames, and is the first
    pose until then.
    """
    rows = np.maximum(np.arange(len(theta)) - model.look_ahead, 0)
    offsets_m, shown = skin_offsets(model, body, theta, betas)[rows], theta[rows]
    return smpl.posed_vertices(body, betas[None], *unpack_theta(shown), offsets_m)


def skin_offsets(model: TrainedPlus, body: BodyModelData, theta: Array, betas: Array) -> Array:
    """Offsets (T, V, 3) of the skin, metres, over a motion theta (T, 69) that ends at rest."""
    nodes, at_nodes = model.nodes, node_offsets(model, body, theta, betas)
    offsets_m = np.einsum("vk,tvkx->tvx", nodes.shares, at_nodes[:, nodes.owners])
    return offsets_m + _static_m(model, body, theta, betas)


def _static_m(model: TrainedPlus, body: BodyModelData, theta: Array, betas: Array) -> Array:
    """(T, V, 3) what the offsets have of the pose alone, and known people for ever."""
    nodes, static = model.nodes, model.static
    static_m = np.zeros((len(theta), len(nodes.owners), 3))
    if static.constant_m.any():
        static_m += np.tensordot(known_person(betas, model.people_betas), static.constant_m, 1)
    if static.by_pose_m.any():
        turned = smpl.rotations(unpack_theta(np.asarray(theta, np.float64))[0])
        features = (turned[:, 1:] - np.eye(3)).reshape(len(theta), -1)
        at_nodes = np.tensordot(features, static.by_pose_m.astype(np.float64), 1)
        static_m += np.einsum("vk,tvkx->tvx", nodes.shares, at_nodes[:, nodes.owners])
    return static_m


def node_offsets(model: TrainedPlus, body: BodyModelData, theta: Array, betas: Array) -> Array:
    """Offsets (T, K, 3) of the nodes, metres, over a motion theta (T, 69) that ends at rest."""
    c = coefficients(model, body, betas)
    loads = _loads(model, c, body, theta, betas)
    oscillators = Oscillators(c, model.nodes.laplacian.toarray().astype(np.float64))
    now = before = oscillators.settled(loads[0])
    offsets_m, taps = [now], model.weights.taps.astype(np.float64)
    for frame in range(1, len(theta)):
        newest = frame - 1 + model.look_ahead
        recent = loads[np.clip(newest - np.arange(len(taps)), 0, len(loads) - 1)]
        now, before = oscillators.frame(now, before, np.tensordot(taps, recent, 1))
        offsets_m.append(now)
    return np.stack(offsets_m)


def coefficients(model: TrainedPlus, body: BodyModelData, betas: Array) -> Coefficients:
    """The coefficients that a `dsnet_plus` gives a shape, betas (10,)."""
    weights = model.weights
    nodes, shape = model.nodes.vertices, np.asarray(betas, np.float64)
    features = np.log(shape_measures(body, shape, nodes) / shape_measures(body, 0 * shape, nodes))
    shares = shares_of_people(betas, model.people_betas)
    log_omega = features @ weights.slopes + np.tensordot(shares, weights.residual, 1)
    logs = {name: np.asarray(log, np.float64) for name, log in weights.base.items()}
    normals = vertex_normals(shaped_vertices(body, shape[None])[0], body.faces)[nodes]
    return Coefficients.of_logarithms(logs, log_omega, weights.stiffening_power, normals)


def _loads(
    model: TrainedPlus, c: Coefficients, body: BodyModelData, theta: Array, betas: Array
) -> Array:
    """Loads (T, K, 3); the acceleration of the first and last frame is zero.

    Skinning weights are corrected to sum to exactly 1, so that a body at rest has exactly no load.
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
    return c.load(inertia, back @ _GRAVITY_M_S2 - _GRAVITY_M_S2)


def predict(w: Arrays, given: Arrays) -> Array:
    """Offsets (T, K, B, 3) of a batch of B windows; weights have the Keras layer's names."""
    return np.stack([_window(w, given, clip) for clip in range(given["now"].shape[1])], axis=2)


def learn(w: Arrays, given: Arrays) -> Pass:
    """Loss, and the gradients of the sum of loss and prior, by complex steps."""
    gradients = {}
    for name, values in w.items():
        slopes = np.zeros(values.size)
        for place in range(values.size):
            changed = values.astype(np.complex128)
            changed.flat[place] += 1j * smpl.H
            stepped = {**w, name: changed}
            total = _loss(predict(stepped, given), given) + _prior(stepped)
            slopes[place] = np.imag(total) / smpl.H
        gradients[name] = slopes.reshape(values.shape)
    offsets = predict(w, given)
    return Pass(float(_loss(offsets, given)), gradients, {}, {"offsets": offsets})


def _window(w: Arrays, given: Arrays, clip: int) -> Array:
    """Offsets (T, K, 3) of one window."""
    log_omega = given["features"][:, clip] @ w["slopes"]
    residual = w["residual"] - w["residual"].mean(0)
    log_omega = log_omega + np.tensordot(given["shares"][clip], residual, 1)  # (K, 1)
    logs = {name: w[f"log_{name}"] + w[f"by_node_{name}"] for name in _PRIOR}
    normals = given["normals"][:, clip]
    normals = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
    c = Coefficients.of_logarithms(logs, log_omega, w["stiffening_power"], normals)
    loads = c.load(given["inertia"][:, :, clip], given["gravity"][:, :, clip])
    oscillators, taps = Oscillators(c, given["laplacian"]), w["taps"] / w["taps"].sum()
    now, before = given["now"][:, clip], given["before"][:, clip]
    offsets = []
    for newest in range(len(taps) - 1, len(loads)):
        load = np.tensordot(taps, loads[newest - np.arange(len(taps))], 1)
        now, before = oscillators.frame(now, before, load)
        offsets.append(now)
    return np.stack(offsets)


def _loss(predicted: Array, given: Arrays) -> Array:
    """Error relative to the energy of the batch, and some of each window's relative error."""
    counted, target = given["counted"], given["target"]
    missed, energy = (
        (counted * values**2).mean((0, 1, 3)) for values in (predicted - target, target)
    )
    quiet = counted.mean((0, 1, 3)) * _QUIET_M**2
    return missed.sum() / energy.sum() + _QUIET_SHARE * (missed / (energy + quiet)).mean()


def _prior(w: Arrays) -> Array:
    """Penalty on differences between nodes, on residuals of subjects, and on gains other than 1."""
    uneven = sum(weight * (w[f"by_node_{name}"] ** 2).mean() for name, weight in _PRIOR.items())
    gains = sum((w[f"log_{name}"] ** 2).sum() for name in ("inertia_gain", "gravity_gain"))
    return uneven + _GAINS * gains + _PEOPLE * (w["residual"] ** 2).mean()


def oscillators_train(w: Arrays, steps: list[int], learning_rate: float, **given: Array) -> Tensors:
    """Offsets of windows, loss, gradients, steps of Adam."""
    rule = replace(KERAS_ADAM, learning_rate=learning_rate, beta_2=0.95)
    offsets = prefixed("layer", {"offsets": predict(w, given)})
    return offsets | train(w, lambda now: learn(now, given), rule, steps)


def soft_tissue(w: Arrays, theta: Array, betas: Array, body: str) -> Tensors:
    """Offsets (T, B, V, 3) of the skin of B people with poses theta (T, B, 69)."""
    return {"layer/offsets": _of_people(w, theta, betas, body)}


def soft_tissue_slopes(w: Arrays, theta: Array, betas: Array, body: str, **given: Array) -> Tensors:
    """How sum(probe * offsets) grows in each direction `towards/NAME` (D, ...) of poses, shapes and
    weights: differences of fourth order in float64, as not all of it takes complex numbers."""
    probe = given.pop("probe")
    slopes = {}
    for name, directions in given.items():
        variable = name.removeprefix("towards/")

        def total(step: Array, variable: str = variable) -> float:
            moved = {"theta": theta, "betas": betas, **w}
            moved[variable] = moved[variable] + step
            weights = {key: moved[key] for key in w}
            offsets = _of_people(weights, moved["theta"], moved["betas"], body)
            return float((probe * offsets).sum())

        slopes[variable] = np.array(
            [
                sum(share * total(_STEP * k * towards) for k, share in _STENCIL.items()) / _STEP
                for towards in directions
            ]
        )
    return prefixed("grad", slopes)


def _of_people(w: Arrays, theta: Array, betas: Array, body: str) -> Array:
    model, data = TrainedPlus.from_arrays(w), load_body_model(body)
    people = zip(theta.swapaxes(0, 1), betas, strict=True)
    return np.stack([skin_offsets(model, data, *one) for one in people], axis=1)


def plus_graph(w: Arrays, theta: Array, betas: Array, body: str) -> Tensors:
    """Posed skin of B characters with poses theta (T, B, 69), by `dsnet_plus`."""
    model, data = TrainedPlus.from_arrays(w), load_body_model(body)
    characters = zip(theta.swapaxes(0, 1), betas, strict=True)
    clips = [posed_vertices(model, data, poses, shape) for poses, shape in characters]
    return {"layer/vertices": np.stack(clips, axis=1)}
