"""The oscillators of `dsnet_plus` as a recurrent Keras layer, and a step of their training.

`bridge/tissue/oscillators.py` has the equations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.paper import FPS
from bridge.tissue.learning import GAIN_PRIOR, NODE_PRIOR, PEOPLE_PRIOR, QUIET_M, QUIET_SHARE
from bridge.tissue.oscillators import STEPS, SWEEPS
from bridge.tissue.shape import SHAPE_FEATURES
from bridge.tissue.trained_plus import NODE_FIELDS, SAG_POWER, Weights
from tf_dsnet.framework import Tensor, keras, tf

_STEP_S = 1 / (STEPS * FPS)
Batch = Mapping[str, Tensor]
"""Arguments of the layer, `target` (T, K, B, 3), and `counted` (T, 1, B, 1), 0 for frames that do
not count."""
START = {
    "omega": 2 * np.pi * 7.0,
    "damping_ratio": 0.15,
    "stiffening": 700.0,
    "sag": 5e-3,
    "normal_ratio": 1.2,
    "wave_speed": 1.0,
    "bending": 1e-3,
    "inertia_gain": 1.0,
    "gravity_gain": 1.0,
}
"""Initial coefficients, of firm tissue."""


class OscillatorLayer(keras.layers.Layer):
    """Offsets of K nodes over time from the loads on them: a recurrent layer of state (u, u-).

    Parameters
    ----------
    laplacian : (K, K) of `TissueNodes`.
    people : number P of people in training.
    taps : number of frames whose loads act on a step.
    """

    def __init__(self, laplacian: NDArray, people: int, taps: int) -> None:
        super().__init__(name="oscillators")
        count, dtype = len(laplacian), keras.config.floatx()
        laplacian = laplacian.astype(np.float64)
        # Dense, as with 500 nodes it is faster than TensorFlow's sparse product.
        self._laplacian = tf.constant(laplacian, dtype)
        self._twice_laplacian = tf.constant(laplacian @ laplacian, dtype)
        logs = {name: float(np.log(START[name])) for name in NODE_FIELDS}
        self._base = {n: self._weight(f"log_{n}", (1,), log) for n, log in logs.items()}
        self._deviation = {n: self._weight(f"by_node_{n}", (count, 1)) for n in NODE_FIELDS}
        self._slopes = self._weight("slopes", (len(SHAPE_FEATURES), 1))
        self._stiffening_power = self._weight("stiffening_power", (1,))
        self._residual = self._weight("residual", (people, count, 1))
        self._taps = self._weight("taps", (taps,), 1.0 / taps)

    def _weight(self, name: str, shape: tuple[int, ...], value: float = 0.0) -> keras.Variable:
        start = keras.initializers.Constant(value)
        return self.add_weight(name=name, shape=shape, initializer=start)

    def call(self, inertia: Tensor, gravity: Tensor, now: Tensor, before: Tensor,
             normals: Tensor, features: Tensor, shares: Tensor) -> Tensor:  # fmt: skip
        """Offsets (T, K, B, 3) of the frames that follow `now`.

        Parameters
        ----------
        inertia, gravity : (T + N - 1, K, B, 3) loads, m/s^2, from the oldest tap of the first
            step to the newest of the last one.
        now, before : (K, B, 3) initial offsets, metres, a step apart, not a frame.
        normals : (K, B, 3) of each clip's person, in the rest pose.
        features : (K, B, 3) of `shape_features`, of each clip's person.
        shares : (B, P) of `shares_of_people`.
        """
        # Deviation (K, B, 1) of log W of each clip's person from the template's.
        deviation = tf.tensordot(features, self._slopes, 1)
        deviation += tf.einsum("bp,pkx->kbx", shares, self._residuals())
        omega = self._coefficient("omega") * tf.exp(deviation)
        stiffening = self._coefficient("stiffening") * tf.exp(self._stiffening_power * deviation)
        sag = self._coefficient("sag") * tf.exp(SAG_POWER * deviation)
        springs, sag_vector, weight = self._springs(omega, stiffening, sag, normals)
        taps = tf.unstack(self._normalised_taps())
        load = self._coefficient("inertia_gain") * _smoothed(inertia, taps)
        load += self._coefficient("gravity_gain") * _smoothed(gravity, taps)
        loads = _STEP_S**2 * tf.repeat(load, STEPS, 0) + weight
        # The state is relative to the weightless shape, from which `weight` pulls the tissue down.

        def step(state: tuple[Tensor, Tensor], load: Tensor) -> tuple[Tensor, Tensor]:
            now, before = state
            return _step(normals, load, now, before, springs), now

        steps, _ = tf.scan(step, loads, (now + sag_vector, before + sag_vector))
        return steps[STEPS - 1 :: STEPS] - sag_vector

    def _springs(
        self, omega: Tensor, stiffening: Tensor, sag: Tensor, normals: Tensor
    ) -> tuple[Springs, Tensor, Tensor]:
        """Coefficients of a step, (K, B, 1) each; sag s and weight times dt^2, (K, B, 3)."""
        ratio = self._coefficient("normal_ratio") * tf.ones_like(omega)
        sag_vector = sag * tf.constant([0.0, -1.0, 0.0], sag.dtype)
        stretched = _stretched(sag_vector, ratio - 1, normals)
        taut = stiffening * _dot(sag_vector, stretched)
        spring = _STEP_S**2 / 4 * tf.square(omega) / (1 + 3 * taut)
        tension = tf.square(self._coefficient("wave_speed"))
        bending = self._coefficient("bending")
        coupling = tension[:, 0] * self._laplacian + bending[:, 0] * self._twice_laplacian
        between = _STEP_S**2 / 4 * coupling
        bound = tf.reduce_sum(tf.abs(between), 1)
        springs = Springs(
            drag=self._coefficient("damping_ratio") * omega * _STEP_S,
            spring=spring,
            hardening=2 * spring * stiffening,
            normal_ratio=ratio,
            bound=bound[:, None, None],
            rest=tf.linalg.diag(bound) - between,
        )
        weight = 4 * (spring * (1 + taut) * stretched + _times(between, sag_vector))
        return springs, sag_vector, weight

    def _coefficient(self, name: str) -> Tensor:
        """(K, 1, 1) of the template body."""
        return tf.exp(self._base[name] + self._deviation[name])[:, None]

    def _residuals(self) -> Tensor:
        """(P, K, 1) without their mean over people, which belongs to the template instead."""
        residual = tf.convert_to_tensor(self._residual)
        return residual - tf.reduce_mean(residual, 0, keepdims=True)

    def _normalised_taps(self) -> Tensor:
        taps = tf.convert_to_tensor(self._taps)
        return taps / tf.reduce_sum(taps)

    def penalty(self) -> Tensor:
        """Prior: nodes are alike, people differ by their shape alone, and gains are 1.

        Strengths are per node and in units of the loss, where the data outweigh them.
        """
        terms = [w * tf.reduce_mean(tf.square(self._deviation[n])) for n, w in NODE_PRIOR.items()]
        gains = [self._base[name] for name in ("inertia_gain", "gravity_gain")]
        terms += [GAIN_PRIOR * tf.reduce_sum(tf.square(gain)) for gain in gains]
        terms += [PEOPLE_PRIOR * tf.reduce_mean(tf.square(tf.convert_to_tensor(self._residual)))]
        return sum(terms)

    def weights_as_arrays(self) -> Weights:
        """The learned weights; base and deviation of each node are added."""
        logs = {name: self._base[name] + self._deviation[name] for name in NODE_FIELDS}
        base = {name: log.numpy().astype(np.float32) for name, log in logs.items()}
        others = (self._slopes, self._stiffening_power, self._residuals(), self._normalised_taps())
        return Weights(base, *(part.numpy() for part in others))


def _smoothed(load: Tensor, taps: Sequence[Tensor]) -> Tensor:
    """Weighted sums (T, K, B, 3) of loads (T + N - 1, K, B, 3), the newest by the first tap."""
    newest = len(taps) - 1
    count = tf.shape(load)[0] - newest
    return sum(tap * load[newest - i : newest - i + count] for i, tap in enumerate(taps))


class Springs(NamedTuple):
    """Coefficients of K nodes of B clips, times dt or dt^2 so that they have no unit of time."""

    drag: Tensor  # (K, B, 1) Z W dt
    spring: Tensor  # (K, B, 1) dt^2 / 4 times w^2
    hardening: Tensor  # (K, B, 1) dt^2 / 2 times w^2 a, 1/m^2
    normal_ratio: Tensor  # (K, B, 1) p
    bound: Tensor  # (K, 1, 1) N: sums over rows of the absolute coupling
    rest: Tensor  # (K, K) N - dt^2 C / 4


def _step(normals: Tensor, load: Tensor, now: Tensor, before: Tensor, springs: Springs) -> Tensor:
    """The offsets (K, B, 3) after `now`; loads are multiplied by dt^2. All in metres."""
    normal, rest = springs.normal_ratio - 1, springs.rest
    stiffer = springs.hardening * _dot(now, _stretched(now, normal, normals))
    twice, straight = 2 * now + before, 2 * now - before
    pulled = springs.spring * twice + stiffer * before
    right = load + straight + springs.drag * before - _stretched(pulled, normal, normals)
    right += _times(rest, twice) - springs.bound * twice
    held = springs.spring + stiffer
    along = 1 + springs.drag + springs.bound + held
    after = straight
    for _ in range(SWEEPS):
        after = _divided(right + _times(rest, after), along, normal * held, normals)
    return after


def _stretched(offsets: Tensor, normal: Tensor, normals: Tensor) -> Tensor:
    """P u = u + (p - 1) (n . u) n, with `normal` p - 1."""
    return offsets + normal * _dot(offsets, normals) * normals


def _divided(left: Tensor, along: Tensor, beyond: Tensor, normals: Tensor) -> Tensor:
    """Apply the inverse of each node's block along I + beyond n n^T (Sherman and Morrison)."""
    return (left - beyond / (along + beyond) * _dot(left, normals) * normals) / along


def _dot(first: Tensor, second: Tensor) -> Tensor:
    return tf.reduce_sum(first * second, -1, keepdims=True)


def _times(matrix: Tensor, offsets: Tensor) -> Tensor:
    """A matrix (K, K) times offsets (K, B, 3)."""
    shape = tf.shape(offsets)
    flat = tf.reshape(offsets, (shape[0], -1))
    return tf.reshape(tf.matmul(matrix, flat), shape)


class OscillatorLearner:
    """Trains a layer on batches of windows: steps of the optimizer, loss and gradient."""

    def __init__(self, layer: OscillatorLayer, learning_rate: float) -> None:
        self.layer = layer
        # Named, as checkpoints contain the name, and Keras would number it.
        self.optimizer = keras.optimizers.Adam(learning_rate, beta_2=0.95, name="adam")
        self.optimizer.build(layer.trainable_variables)
        self.gradients = tf.function(self._gradients, reduce_retracing=True)
        """Loss of a batch, and the gradient of loss and penalty with respect to the weights."""
        self.step = tf.function(self._step, reduce_retracing=True)
        """Take a step on a batch; gives the loss before it."""

    def offsets(self, batch: Batch) -> Tensor:
        """Offsets (T, K, B, 3) of a batch, metres."""
        return self.layer(batch["inertia"], batch["gravity"], batch["now"], batch["before"],
                          batch["normals"], batch["features"], batch["shares"])  # fmt: skip

    def _gradients(self, batch: Batch) -> tuple[Tensor, list[Tensor]]:
        loss = _loss(self.offsets(batch), batch["target"], batch["counted"])
        weights = [weight.value for weight in self.layer.trainable_variables]
        # Not by a tape, which adds many terms in no fixed order: see `be_reproducible`.
        return loss, tf.gradients(loss + self.layer.penalty(), weights)

    def _step(self, batch: Batch) -> Tensor:
        loss, gradients = self._gradients(batch)
        self.optimizer.apply(gradients, self.layer.trainable_variables)
        return loss


def _loss(offsets: Tensor, target: Tensor, counted: Tensor) -> Tensor:
    """Squared error over energy of all clips, plus a small term with equal weights of clips."""
    error = tf.reduce_mean(counted * tf.square(offsets - target), (0, 1, 3))
    energy = tf.reduce_mean(counted * tf.square(target), (0, 1, 3))
    quiet = tf.reduce_mean(counted, (0, 1, 3)) * QUIET_M**2
    overall = tf.reduce_sum(error) / tf.reduce_sum(energy)
    return overall + QUIET_SHARE * tf.reduce_mean(error / (energy + quiet))
